#pragma once

#include "apps/program/command.hpp"

namespace orbid::apps {

/// orbid run, simulate, orbits, periodic, estimate JOB.json: all stages of a job, or one.
/// @return exit code, as run_job; 2 or 3 with every problem of the job on standard error.
[[nodiscard]] int run_all_stages(const CommandCall& call);
[[nodiscard]] int run_simulation(const CommandCall& call);
[[nodiscard]] int run_orbits(const CommandCall& call);
[[nodiscard]] int run_periodic(const CommandCall& call);
[[nodiscard]] int run_estimation(const CommandCall& call);

/// orbid check JOB.json: all problems of the job on standard error, what it would run on standard output.
[[nodiscard]] int check_job(const CommandCall& call);

}  // namespace orbid::apps
