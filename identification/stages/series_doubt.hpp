#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// States along a record, and what a model leaves of the readings from each on.
struct StateResiduals {
    Eigen::MatrixXd states;   ///< shape (n, m), over the ranges, in the order of the record; angles in turns
    std::vector<char> angle;  ///< shape (n): a coordinate is one
    /// Shape (k, m): residuals of the readings 0, 1, ... samples after each state; nan where there is none.
    Eigen::MatrixXd residual;
};

/// Correlation of what is left of readings after nearly the same state, but not at nearly the same time.
struct NeighbourCorrelation {
    double value = 0.0;
    double limit = 1e300;  ///< independent errors stay below it, but for one chance in a million
};

/// A model that is wrong, or at the wrong parameters, leaves a function of the state; errors of reading leave none. So
/// what is left after a state and after its nearest neighbour are compared, for up to 2048 states spread over the
/// record:
///
///     c = mean((u_i - m) (u_j - m)) / var(u),   u = residual / (1.4826 median |residual|), cut off at 3,  m = mean(u)
///
/// of which independent errors make a normal number with sd sqrt(2 / pairs) at most. Neighbours within ten states in
/// the record are no pair. Cost: 2048 times up to 65 536 distances.
[[nodiscard]] NeighbourCorrelation neighbour_correlation(const StateResiduals& readings);

/// Why the estimate of a stage of series cannot be taken for the last word: what is against it, in half a sentence.
/// Empty: the series is explained. It has converged with all readings used; no more intervals than expected miss the
/// next node, none by more than readings err; and what is left of the readings are independent errors: neither in
/// succession nor after neighbouring states (neighbour_correlation()) do they know of each other. Another minimum would
/// have to explain all readings as well, by other parameters. What is too short to tell is not explained.
[[nodiscard]] std::string series_doubt(const models::System& system, const StageRun& run);

/// A group of readings that the estimate of a stage meets to rounding, although their errors are estimated: links from
/// node to node take up what the model misses, and the smaller the errors the higher the likelihood, without end.
/// Empty: none.
[[nodiscard]] std::string group_without_errors(const StageRun& run);

/// Whether a strategy is a series over whole segments alone that asks for nodes where it needs some, and has segments
/// long enough for them.
[[nodiscard]] bool may_need_nodes(const IdentificationProblem& problem, const std::vector<Stage>& strategy);

/// Why the end of such a strategy may not be the last word: it did not succeed, or leaves more than half of the spread
/// of a coordinate. Empty: neither.
[[nodiscard]] std::string whole_segments_doubt(const StageRun& run);

}  // namespace orbid::identification
