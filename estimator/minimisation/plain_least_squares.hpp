#pragma once

#include "estimator/minimisation/minimum.hpp"
#include "estimator/problem/block_set.hpp"

namespace orbid::estimator {

/// Whether the estimate of the parameters is a plain least-squares problem. Conditions: one law of normal errors,
/// records independent of each other, no latent states, no constraints, no prior on the parameters (bounds are
/// allowed). The minimum over the parameters is then the same for every error scale, and can be found before the scale.
[[nodiscard]] bool is_plain_least_squares(const Problem& problem, const BlockSet& set);

struct PlainSolution {
    Evaluation evaluation;   ///< at the state, with derivatives; blocks that fail at the start are named in it
    bool exhausted = false;  ///< full steps no longer shorten what is left: they gain no digits
};

/// Moves the state to a minimum of the sum of squares by Levenberg-Marquardt steps with geodesic acceleration. Ends
/// with plain Gauss-Newton steps as long as they gain digits.
///
/// Only moves the state: minimise() judges the result and continues from there. It stops early, without harm, where
/// more care is needed: at a bound, at blocks that fail beside others that do not, at a parameter combination without
/// information. Damping by the largest column norms met so far (More, LNM 630 (1978) 105), updated by the gain
/// (Nielsen, IMM-REP-1999-05), the second-order correction along the geodesic (Transtrum and Sethna, arXiv:1201.5885).
/// Measured when it was introduced, over the 54 NIST and 57 More-Garbow-Hillstrom runs without / with the correction:
/// 52 and 43 / 54 and 47 successes with 24000 / 13000 derivatives.
[[nodiscard]] PlainSolution solve_plain_least_squares(const Problem& problem, const BlockSet& set, State& state,
                                                      SolverStatistics& ledger);

}  // namespace orbid::estimator
