#include "apps/results/checkpoint.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"

namespace orbid::apps {

namespace {

constexpr const char* file_name = "checkpoint.bin";
// Changes with what is kept in a checkpoint: values of another layout must not be taken for ours.
constexpr std::string_view checkpoint_format = "orbid-checkpoint/10";
// The hash of all that follows stands first: what a disk lost or somebody changed is not taken up. Then the
// fingerprint, and pairs of a name and its bytes until the end.
constexpr std::size_t hash_length = 64;

/// A pair in a content.
struct Pair {
    std::size_t begin = 0, end = 0;  ///< where it stands
    std::string_view bytes;
};

/// @param first  where the pairs begin.
std::optional<Pair> pair_named(std::string_view content, std::size_t first, std::string_view name) {
    Archive archive(content.substr(first));
    const auto place = [&](std::string_view text) { return static_cast<std::size_t>(text.data() - content.data()); };
    Pair pair{first, first, {}};
    while (!archive.at_end()) {
        const std::string_view found = archive.text();
        pair.bytes = archive.text();
        pair.end = place(pair.bytes) + pair.bytes.size();
        if (found == name) return pair;
        pair.begin = pair.end;
    }
    return std::nullopt;
}

}  // namespace

Checkpoint::Checkpoint(OutputFolder& folder, const Fingerprint& fingerprint)
    : folder_(folder), head_(hash_length, ' ') {
    std::string stored = fmt::format("{} {}", checkpoint_format, fingerprint.sha256);
    Archive archive(head_);
    archive(stored);
}

/// The content of the file; that of one without pairs where there is none of ours.
std::string Checkpoint::content() const {
    const std::filesystem::path file = folder_.file(file_name);
    if (folder_.in_memory() || !std::filesystem::exists(file)) return head_;
    try {
        std::string stored = read_whole_file(file);
        const auto after_hash = [](std::string_view all) { return all.substr(std::min(all.size(), hash_length)); };
        const bool ours = after_hash(stored).starts_with(after_hash(head_));
        if (!ours || !stored.starts_with(sha256(after_hash(stored)))) return head_;
        for (Archive pairs(std::string_view(stored).substr(head_.size())); !pairs.at_end();) {
            (void)pairs.text();  // throws where they are damaged
            (void)pairs.text();
        }
        return stored;
    } catch (const std::runtime_error&) {
        return head_;
    }
}

std::optional<std::string> Checkpoint::find(const std::string& name) const {
    const std::string stored = content();
    const auto pair = pair_named(stored, head_.size(), name);
    return pair ? std::optional(std::string(pair->bytes)) : std::nullopt;
}

void Checkpoint::keep_bytes(std::string name, std::string& bytes) {
    if (folder_.in_memory()) return;
    std::string stored = content();
    if (const auto before = pair_named(stored, head_.size(), name))
        stored.erase(before->begin, before->end - before->begin);
    constexpr std::size_t sizes = 2 * sizeof(std::uint64_t);
    stored.reserve(stored.size() + sizes + name.size() + bytes.size());
    Archive archive(stored);
    archive(name, bytes);
    stored.replace(0, hash_length, sha256(std::string_view(stored).substr(hash_length)));
    folder_.store(file_name, stored);
}

void Checkpoint::remove() {
    std::error_code absent;
    std::filesystem::remove(folder_.file(file_name), absent);
}

}  // namespace orbid::apps
