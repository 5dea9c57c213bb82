#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/stages/run_options.hpp"

#pragma GCC visibility push(default)

namespace orbid::apps {

/// A problem of a job: where, and what would be right.
struct JobProblem {
    std::string pointer;     ///< JSON Pointer (RFC 6901); empty: the whole job
    std::size_t line = 0;    ///< from 1; 0: no place
    std::size_t column = 0;  ///< from 1, in bytes
    std::string rule;
    bool data = false;  ///< a data file that cannot be read, not the job itself
    std::string text;   ///< all of it as one line, as the program prints it
};

/// What a run did. Files are in the folder of its options, as the command line leaves them.
struct JobRun {
    int exit_code = 0;                 ///< that of the command line: 0, 1, 2, 3 or 130
    std::vector<JobProblem> problems;  ///< why the job cannot be run: nothing else is meaningful then
    std::string summary;               ///< the tables that the command line prints
    std::string messages;              ///< lines of standard error, progress included (one line per stage)
    std::string result;                ///< content of result.json; empty: no estimate was run
};

/// What a run asks and tells its caller. Both may be called from threads other than the caller's, each one call at a
/// time.
struct JobRunCalls {
    std::function<bool()> stopped;  ///< true: stop at the next step with the best result so far
    std::function<void(std::string_view line)>
        messages;  ///< each line of JobRun::messages as it comes, without its end; one at a time, from any thread
};

/// All problems of a job, including those of its data files, or of a campaign; none: it can be run.
/// @param text    JSON with comments, as in a job file or a campaign file.
/// @param source  path of that file, which need not exist: relative paths in it start at its folder.
[[nodiscard]] std::vector<JobProblem> job_problems(std::string_view text, const std::filesystem::path& source);

/// Runs a job given as text and stores its results, without printing or catching signals. Different threads may run
/// several jobs at once, each into its own folder.
/// @param text, source  as for job_problems().
/// @param options       options.threads limits this run alone.
/// @throws std::invalid_argument without a folder or with threads < 0; std::runtime_error when files cannot be written;
///         what `calls.messages` threw, once the run has ended.
[[nodiscard]] JobRun run_job_text(std::string_view text, const std::filesystem::path& source, const RunOptions& options,
                                  const JobRunCalls& calls = {});

}  // namespace orbid::apps

#pragma GCC visibility pop
