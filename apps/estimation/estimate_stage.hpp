#pragma once

#include <functional>
#include <optional>
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

/// Cycles that an estimate may use.
struct JobCycles {
    std::optional<SearchedSection>
        section;                 ///< that was searched for them; nothing: they come from a file, or none are
    orbits::CycleSearch search;  ///< empty when no residual needs them
};

/// Estimates the job's parameters from its residuals, stores result.json and residuals.csv (and orbits.json, the orbits
/// computed from cycles, unless the job's "periodic" block fills that).
///
/// @param cycles  of the orbits stage.
/// @param find    fills in `cycles` once a stage needs them, which may be never; empty: they are there.
/// @throws orbits::DataError when the data do not suffice for the residuals.
[[nodiscard]] EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data,
                                           JobCycles& cycles, const std::function<void(JobCycles&)>& find = {});

}  // namespace orbid::apps
