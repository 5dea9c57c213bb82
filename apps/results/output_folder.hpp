#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "apps/documents/file_lock.hpp"

namespace orbid::apps {

/// A folder is not overwritten: it holds the result of another job, or files of unknown origin under our names.
class FolderRefused : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Whose results an output folder holds.
enum class FolderContent {
    nothing,     ///< absent, or holds no file under one of our names
    same_job,    ///< job.json describes this job
    other_job,   ///< job.json describes another job
    unknown_job  ///< result files without a job.json that can be read
};

struct FolderState {
    FolderContent content = FolderContent::nothing;
    std::string difference;  ///< other_job, unknown_job: in words, where it differs
};

/// Compares job.json in the folder with the job about to run, as JSON values (layout and order of keys do not count).
/// @param job  what job.json will say. `/versions` is not compared: the same job under a newer program is the same job.
[[nodiscard]] FolderState examine_output_folder(const std::filesystem::path& folder, const nlohmann::json& job);

/// Prepares the folder for a job: creates it with its parents, or accepts it when it holds nothing or the same job, or
/// anything if `force` is set. Existing results stay; each is replaced when its stage is done.
///
/// @throws FolderRefused naming folder and first difference, or why nothing can be stored there; the folder is
/// unchanged
///         then.
void prepare_output_folder(const std::filesystem::path& folder, const nlohmann::json& job, bool force);

/// The folder of one run, which holds a lock on it (FileLock): two runs never write into one folder. job.json is stored
/// with the first result: a run that ends before (unreadable data, a stale file) leaves the folder unchanged, and
/// removes one that it created.
class OutputFolder {
public:
    /// Prepares the folder as above, and locks it.
    /// @throws FolderRefused, also when another process writes there: it names process, host and since when.
    /// @param job       what job.json says, as JSON.
    /// @param job_text  the same, as it is stored.
    OutputFolder(std::filesystem::path folder, const nlohmann::json& job, std::string job_text, bool force);
    /// No folder: of what is stored the content of result.json is kept, and no file can be found.
    OutputFolder();
    ~OutputFolder();
    OutputFolder(const OutputFolder&) = delete;
    OutputFolder& operator=(const OutputFolder&) = delete;

    [[nodiscard]] bool in_memory() const { return in_memory_; }
    /// False where the file system knows no locks: a second run into the folder is not noticed.
    [[nodiscard]] bool is_locked() const { return lock_ && lock_->effective(); }
    /// In memory: the content of result.json; empty when none was stored.
    [[nodiscard]] const std::string& kept_result() const { return kept_result_; }
    [[nodiscard]] std::filesystem::path file(const std::string& name) const { return folder_ / name; }
    /// Stores a file of the run, whole or not at all. Thread-safe. The first one is preceded by job.json. If the folder
    /// held another job (`force`), its results are then removed, except series and cycles: their fingerprints show
    /// whether they fit.
    void store(const std::string& name, std::string_view bytes);
    /// The same for writers that need a path; see write_atomically for `interrupted`.
    void store(const std::string& name, const std::function<void(const std::filesystem::path& temporary)>& writer,
               const std::function<bool()>& interrupted = {});

private:
    void claim();

    void lock(const nlohmann::json& job, bool force);

    std::mutex mutex_;  ///< one file at a time, and none half written when a run is left
    std::filesystem::path folder_;
    std::string job_text_;
    std::optional<FileLock> lock_;
    bool created_ = false;         ///< by this run
    bool of_another_job_ = false;  ///< what it held before
    bool claimed_ = false;
    bool in_memory_ = false;
    std::string kept_result_;
};

}  // namespace orbid::apps
