#pragma once

#include <string>
#include <string_view>

#include "apps/job/job.hpp"
#include "apps/program/console.hpp"
#include "apps/stages/run_options.hpp"

namespace orbid::apps {

/// Runs a job and stores its results.
/// @param color   of summaries: see is_coloured().
/// @param result  of a run in memory: what result.json would hold.
/// @return exit code: 0 done, 1 done without a valid answer, 2 the job names no such stage or the folder belongs to
///         another job, 3 data cannot be used, 130 interrupted.
[[nodiscard]] int run_job(const Job& job, const RunOptions& options, const Console& console,
                          std::string_view color = "auto", std::string* result = nullptr);

}  // namespace orbid::apps
