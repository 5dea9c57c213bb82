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

/// What became of the comparison, and the entry that agrees worst: the one with the largest |derivative - difference|
/// over `allowed`.
struct DerivativeCheck {
    bool passed = true;            ///< no entry differs by more than allowed; also when none could be compared
    std::size_t compared = 0;      ///< entries with a difference quotient that is good enough
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

/// Compares the sensitivities of a flow with difference quotients of the flow: a model whose equations lose
/// derivatives (a branch that looks at values only, a table, a constant that should have been a parameter) disagrees.
///
/// Each direction is differenced with seven steps from 1 % of its size down by factors of 4, to second order, centrally
/// and to either side, and extrapolated. Which of them counts follows from their own estimated errors: how far three
/// steps and their extrapolations are apart, and what the integration error of the flow makes of a small step. So
/// chaos, where only small steps are good, and loose tolerances, where only large ones are, are told from wrong
/// derivatives. Three estimated errors, and what ten times the tolerances change in the derivative, are allowed.
/// Not compared, and counted as inconclusive, are entries where this exceeds a thousandth of the entry (of a small
/// entry: 1e-6 of the size of its coordinate over that of its direction). Flows that end with another status than ok,
/// with another number of switching events than the one through x0, or far from it, are left out. At a start on a
/// switching surface the derivative is one-sided: an entry that agrees with the quotient to one side passes.
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
