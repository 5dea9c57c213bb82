#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

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

/// Makes the folder ready for a job: creates it with its parents, or accepts it when it holds nothing or the same job,
/// or anything when `force` is set. Existing results stay where they are; each is replaced when its stage is done.
///
/// @throws FolderRefused naming folder and first difference; the folder is unchanged then.
/// @throws std::runtime_error when the folder cannot be created.
void prepare_output_folder(const std::filesystem::path& folder, const nlohmann::json& job, bool force);

}  // namespace orbid::apps
