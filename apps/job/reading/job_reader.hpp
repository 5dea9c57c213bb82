#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/job/job.hpp"

namespace orbid::apps {

/// A job, or everything that is wrong with it.
struct JobReading {
    std::optional<Job> job;         ///< empty when there are problems
    std::vector<Problem> problems;  ///< by line

    /// 0; 2 when the job is wrong; 3 when only data files it names are missing.
    [[nodiscard]] int exit_code() const;
};

/// Reads and checks a job: syntax, keys, types, ranges, names against the model, existence of data files.
///
/// All problems of the file are reported at once (after a syntax error: that one). Names and values that are reserved
/// for methods not built yet are refused with "not in this version".
/// @param text    JSON with comments.
/// @param source  path of the job file: relative paths in the job start at its folder.
[[nodiscard]] JobReading read_job(std::string_view text, const std::filesystem::path& source);

/// The same from a file; one that cannot be read is a problem like any other.
[[nodiscard]] JobReading read_job_file(const std::filesystem::path& file);

/// Reads the model and the section of a job alone; its other keys are not looked at, so that files which the job names
/// need not be there.
[[nodiscard]] JobReading read_job_model(std::string_view text, const std::filesystem::path& source);

}  // namespace orbid::apps
