#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/job/job.hpp"

namespace orbid::apps {

/// A job, or all its problems.
struct JobReading {
    std::optional<Job> job;         ///< empty when there are problems
    std::vector<Problem> problems;  ///< by line

    /// 0; 2 when the job is invalid; 3 when only data files are missing.
    [[nodiscard]] int exit_code() const;
};

/// Reads and checks a job: syntax, keys, types, ranges, names against the model, existence of data files.
///
/// All problems of the file are reported at once (after a syntax error: that one). What no method is built for yet is
/// refused with "not in this version".
/// @param text    JSON with comments.
/// @param source  path of the job file: relative paths in the job start at its folder.
[[nodiscard]] JobReading read_job(std::string_view text, const std::filesystem::path& source);

/// The same from a file; an unreadable file is reported as a problem.
[[nodiscard]] JobReading read_job_file(const std::filesystem::path& file);

/// Reads only the model and the section of a job. Other keys are ignored, so files that the job names need not exist.
[[nodiscard]] JobReading read_job_model(std::string_view text, const std::filesystem::path& source);

}  // namespace orbid::apps
