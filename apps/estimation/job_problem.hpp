#pragma once

#include <span>

#include "apps/job/job.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/searched_section.hpp"
#include "identification/problem/identification_options.hpp"
#include "identification/problem/identification_problem.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// What a job and its records give to an identification. It refers to the records, which must outlive it.
/// @param data  one per experiment of the job; none: records are not needed.
[[nodiscard]] identification::IdentificationProblem identification_problem(const Job& job,
                                                                           std::span<const Experiment> data);

/// Adds the measured cycles.
/// @param section  searched for them; nullptr: they come from a file. Must outlive the problem.
void add_measured_cycles(const Job& job, const SearchedSection* section, const orbits::CycleSearch& search,
                         identification::IdentificationProblem& problem);

[[nodiscard]] identification::Options identification_options(const Job& job);

/// The measured motions of the job's residual of type branch; reads their file.
/// @throws orbits::DataError
[[nodiscard]] identification::BranchChoice measured_branch(const Job& job);

}  // namespace orbid::apps
