#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/identification_result.hpp"
#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// Defects at the nodes of every series of a stage, at its estimate; empty without nodes.
/// @param compared  estimate again with ten times looser matching and report how far the parameters move, see
///                  orbits::ContinuityReport. Not done with other residuals in the stage, or unless it has converged.
[[nodiscard]] std::vector<MatchingResult> matching_results(const StageInput& input, const StageRun& run, bool compared);

/// Errors of readings over their ranges, as far as matching knew them; of several series the geometric mean. Empty
/// without nodes.
[[nodiscard]] std::optional<double> matched_noise(const StageRun& run);

/// Intervals and nodes of the series at the estimate.
[[nodiscard]] SeriesStart estimated_nodes(const StageRun& run);

}  // namespace orbid::identification
