#pragma once

#include <filesystem>
#include <string>

#include "apps/job.hpp"

namespace orbid::apps {

/// What a command runs of a job: all stages it names, or one.
enum class Stage { all, simulate, orbits, periodic, estimate };

/// What the command line says beside the job file.
struct RunOptions {
    std::filesystem::path out;  ///< folder of the result files
    int threads = 0;            ///< 0 = all cores
    bool quiet = false;         ///< no progress on standard error
    bool force = false;         ///< overwrite a folder that holds the result of another job
    Stage stage = Stage::all;
    /// The process is there for this run alone: asked to stop, the run may end it where a computation cannot be
    /// stopped.
    bool own_process = false;
    std::string color = "auto";  ///< of summaries: see is_coloured()
};

/// Runs a job and stores its results.
/// @return exit code: 0 done, 1 done without a valid answer, 3 data cannot be used, 130 interrupted.
[[nodiscard]] int run_job(const Job& job, const RunOptions& options);

}  // namespace orbid::apps
