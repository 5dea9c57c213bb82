#include "apps/results/output_folder.hpp"

#include <unistd.h>

#include <array>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_difference.hpp"
#include "apps/documents/json_value.hpp"

namespace orbid::apps {
namespace {

/// The result files of the contract; job.json is looked at separately.
constexpr std::array<std::string_view, 18> result_names{
    "estimate_orbits.json", "model_section.svg", "series.h5",    "series.csv",  "cycles.json",     "invariants.json",
    "orbits.json",          "branch.json",       "branch.csv",   "branch.svg",  "result.json",     "section.svg",
    "residuals.csv",        "timing.json",       "waveform.svg", "report.html", "prediction.json", "predictions.csv"};

constexpr std::string_view lock_name = ".orbid-lock";

/// Those that no stage takes up again.
constexpr std::array<std::string_view, 15> unsigned_names{
    "estimate_orbits.json", "model_section.svg", "invariants.json", "branch.csv",      "branch.svg",
    "result.json",          "residuals.csv",     "section.svg",     "timing.json",     "log.txt",
    "waveform.svg",         "report.html",       "checkpoint.bin",  "prediction.json", "predictions.csv"};

}  // namespace

FolderState examine_output_folder(const std::filesystem::path& folder, const nlohmann::json& job) {
    const auto stored_path = folder / "job.json";
    if (std::filesystem::exists(stored_path)) {
        auto stored = json_value_or_discarded(read_whole_file(stored_path), true);
        if (!stored.is_object()) return {FolderContent::unknown_job, "its job.json cannot be read"};
        auto wanted = job;
        stored.erase("versions");
        wanted.erase("versions");
        std::string difference = first_difference(stored, wanted);
        if (difference.empty()) return {FolderContent::same_job, ""};
        return {FolderContent::other_job, std::move(difference)};
    }
    for (const std::string_view name : result_names)
        if (std::filesystem::exists(folder / name))
            return {FolderContent::unknown_job, fmt::format("it holds {} but no job.json", name)};
    return {};
}

namespace {

/// @throws FolderRefused where the folder holds something else.
void refuse_other_job(const std::filesystem::path& folder, const nlohmann::json& job) {
    const FolderState state = examine_output_folder(folder, job);
    if (state.content == FolderContent::other_job)
        throw FolderRefused(
            fmt::format("{} holds the result of another job ({}); choose another --out, or --force "
                        "to overwrite it",
                        folder.string(), state.difference));
    if (state.content == FolderContent::unknown_job)
        throw FolderRefused(
            fmt::format("{} may hold the result of another job ({}); choose another --out, or "
                        "--force to overwrite it",
                        folder.string(), state.difference));
}

}  // namespace

void prepare_output_folder(const std::filesystem::path& folder, const nlohmann::json& job, bool force) {
    std::error_code error;
    if (std::filesystem::exists(folder, error) && !std::filesystem::is_directory(folder, error))
        throw FolderRefused(fmt::format("cannot store results in {}: it is not a folder", folder.string()));
    if (!force) refuse_other_job(folder, job);
    std::filesystem::create_directories(folder, error);
    if (error) throw FolderRefused(fmt::format("cannot create folder {}: {}", folder.string(), error.message()));
    // Known now, not after hours of computing.
    if (::access(folder.c_str(), W_OK | X_OK) != 0)
        throw FolderRefused(fmt::format("cannot store results in {}: it is not writable", folder.string()));
}

namespace {

bool is_there(const std::filesystem::path& path) {
    std::error_code unknown;
    return std::filesystem::exists(path, unknown);
}

}  // namespace

OutputFolder::OutputFolder(std::filesystem::path folder, const nlohmann::json& job, std::string job_text, bool force)
    : folder_(std::move(folder)), job_text_(std::move(job_text)), created_(!is_there(folder_)) {
    lock(job, force);
    // Another run may have ended in between.
    if (!force) refuse_other_job(folder_, job);
    remove_leftover_temporaries(folder_);
    const FolderContent content = examine_output_folder(folder_, job).content;
    of_another_job_ = content == FolderContent::other_job || content == FolderContent::unknown_job;
}

void OutputFolder::lock(const nlohmann::json& job, bool force) {
    // A run that found nothing to store removes the folder that it made: perhaps just now.
    for (int attempt = 0;; ++attempt) {
        prepare_output_folder(folder_, job, force);
        try {
            lock_.emplace(folder_ / lock_name, FileLock::Afterwards::removed);
            return;
        } catch (const LockHeld& held) {
            throw FolderRefused(
                fmt::format("cannot store results in {}: {} writes there; wait for its end, or choose another --out",
                            folder_.string(), held.what()));
        } catch (const std::system_error& error) {
            if (error.code() == std::errc::no_such_file_or_directory && attempt < 3) continue;
            throw FolderRefused(
                fmt::format("cannot store results in {}: {}: {}", folder_.string(), lock_name, error.code().message()));
        }
    }
}

// A path below a device: nothing can be there.
OutputFolder::OutputFolder() : folder_("/dev/null"), in_memory_(true) {}

OutputFolder::~OutputFolder() {
    lock_.reset();
    if (created_ && !claimed_) {
        std::error_code not_empty;  // somebody else's file came in between: the folder stays
        std::filesystem::remove(folder_, not_empty);
    }
}

void OutputFolder::claim() {
    if (claimed_) return;
    if (of_another_job_) {
        for (const std::string_view name : unsigned_names) {
            std::error_code absent;
            std::filesystem::remove(folder_ / name, absent);
        }
    }
    write_atomically(folder_ / "job.json", job_text_);
    claimed_ = true;
}

void OutputFolder::store(const std::string& name, std::string_view bytes) {
    const std::lock_guard lock(mutex_);
    if (in_memory_) {
        if (name == "result.json") kept_result_ = bytes;
        return;
    }
    claim();
    write_atomically(file(name), bytes);
}

void OutputFolder::store(const std::string& name,
                         const std::function<void(const std::filesystem::path& temporary)>& writer,
                         const std::function<bool()>& interrupted) {
    const std::lock_guard lock(mutex_);
    if (in_memory_) return;
    claim();
    write_atomically(file(name), writer, interrupted);
}

}  // namespace orbid::apps
