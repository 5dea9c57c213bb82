#pragma once

#include <vector>

#include "apps/results/result_file.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/searched_section.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// The estimate of a job, and the other contents of the result files.
struct EstimateOutcome {
    estimator::Estimate estimate;
    ResultContext context;
};

/// Estimates the job's parameters from its residuals, stores result.json and residuals.csv (and orbits.json, the orbits
/// computed from cycles, unless the job's "periodic" block fills that).
///
/// @param section  the section searched for cycles; nullptr: none.
/// @param search   cycles of the orbits stage; empty when no residual needs them.
/// @throws orbits::DataError when the data do not suffice for the residuals.
[[nodiscard]] EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data,
                                           const SearchedSection* section, const orbits::CycleSearch& search);

}  // namespace orbid::apps
