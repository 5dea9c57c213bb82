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

/// Sd of matching as a share of the ranges, one for all coordinates and series (geometric mean); empty without nodes.
[[nodiscard]] std::optional<double> matching_share(const StageRun& run);

/// Nodes at the estimate: by experiment of the stage, by fitted segment, shape (n, nodes).
[[nodiscard]] std::vector<std::vector<Eigen::MatrixXd>> estimated_nodes(const StageRun& run);

}  // namespace orbid::identification
