#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

struct DerivativeCheckOptions {
    /// Difference allowed beside the estimated error of the difference quotient, relative to the entry; > 0.
    double relative_tolerance = 1e-5;
    FlowOptions flow{};  ///< for all flows
};

/// Result of the comparison, and the entry that agrees worst: the one with the largest |derivative - difference| over
/// `allowed`.
struct DerivativeCheck {
    bool passed = true;            ///< no entry differs by more than allowed; also when none could be compared
    std::size_t compared = 0;      ///< entries with an accurate enough difference quotient
    std::size_t inconclusive = 0;  ///< entries without one
    Eigen::Index coordinate = -1;  ///< index of the output coordinate, -1 when nothing was compared
    Eigen::Index direction = -1;   ///< column of a sensitivity matrix: the coordinates of the start, then `free`
    double duration = 0.0;         ///< in the units of the clock
    double derivative = 0.0;       ///< as flow_with_sensitivities() says
    double difference = 0.0;       ///< as flow() says
    double relative_error = 0.0;   ///< |derivative - difference| over the larger of both
    double allowed = 0.0;          ///< for |derivative - difference|
    std::string message;           ///< one sentence with names and figures
};

/// Compares the sensitivities of a flow with difference quotients of the flow. They disagree for a model whose
/// equations lose derivatives: a branch that looks at values only, a table, a constant that should have been a
/// parameter.
///
/// Each direction is differenced with seven steps from 1 % of its size down by factors of 4, to second order, centrally
/// and to either side, and extrapolated. The quotient that counts is chosen by its estimated error. This combines how
/// far three steps and their extrapolations are apart with the effect of the flow's integration error on a small step.
/// Chaos, where only small steps are good, and loose tolerances, where only large ones are, are thus distinguished from
/// wrong derivatives. Three estimated errors are allowed, plus the change that ten times the tolerances make in the
/// derivative. Entries where this exceeds a thousandth of the entry are not compared and count as inconclusive. (For a
/// small entry: 1e-6 of the size of its coordinate over that of its direction.) Flows are left out if their status is
/// not ok, or if they end far from the flow through x0 or have another number of switching events. At a start on a
/// switching surface the derivative is one-sided: an entry that agrees with the quotient to one side passes. Where the
/// flow is finite and its derivatives are not, each entry with an accurate quotient counts as wrong.
///
/// @param free  parameters to differentiate with respect to; those at the edge of their domain are differenced inwards
/// @return a status other than ok of the flow itself leaves everything inconclusive, and the message says so.
/// @throws std::invalid_argument as flow_with_sensitivities() does, and for relative_tolerance not > 0
/// Cost: fourteen flows for each direction.
[[nodiscard]] DerivativeCheck check_derivatives(const System& system, const Eigen::VectorXd& x0, double phase,
                                                std::span<const double> durations, const Eigen::VectorXd& theta,
                                                std::span<const Eigen::Index> free, Clock clock,
                                                const DerivativeCheckOptions& options = {});

}  // namespace orbid::models

#pragma GCC visibility pop
