#include "apps/results/checkpoint.hpp"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"

namespace orbid::apps {

namespace {

constexpr const char* file_name = "checkpoint.bin";
// Changes with what is kept in a checkpoint: values of another layout must not be taken for ours.
constexpr std::string_view checkpoint_format = "orbid-checkpoint/7";

}  // namespace

Checkpoint::Checkpoint(OutputFolder& folder, const Fingerprint& fingerprint)
    : folder_(folder), fingerprint_(fmt::format("{} {}", checkpoint_format, fingerprint.sha256)) {
    const std::filesystem::path file = folder.file(file_name);
    if (!std::filesystem::exists(file)) return;
    try {
        const std::string bytes = read_whole_file(file);
        // The hash stands first: what a disk lost or somebody changed is not taken up.
        constexpr std::size_t hash_length = 64;
        const std::string_view content = std::string_view(bytes).substr(std::min(bytes.size(), hash_length));
        if (bytes.substr(0, hash_length) != sha256(content)) return;
        Archive archive(content);
        std::string stored;
        archive(stored);
        if (stored == fingerprint_) archive(kept_);
    } catch (const std::runtime_error&) {
        kept_.clear();
    }
}

const std::string* Checkpoint::find(const std::string& name) const {
    const auto found = std::find_if(kept_.begin(), kept_.end(), [&](const auto& one) { return one.first == name; });
    return found == kept_.end() ? nullptr : &found->second;
}

void Checkpoint::keep_bytes(const std::string& name, std::string bytes) {
    bytes.shrink_to_fit();
    const auto before = std::find_if(kept_.begin(), kept_.end(), [&](const auto& one) { return one.first == name; });
    if (before == kept_.end())
        kept_.emplace_back(name, std::move(bytes));
    else
        before->second = std::move(bytes);
    std::string content;
    Archive archive(content);
    archive(fingerprint_, kept_);
    folder_.store(file_name, sha256(content) + content);
}

void Checkpoint::remove() {
    std::error_code absent;
    std::filesystem::remove(folder_.file(file_name), absent);
}

}  // namespace orbid::apps
