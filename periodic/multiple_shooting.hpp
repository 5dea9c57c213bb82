#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system.hpp"
#include "periodic/orbit.hpp"

namespace orbid::periodic {

struct ShootingOptions {
    /// Converged when closing error and Newton step fall below this x scale, or stagnate at rounding level; > 0. That
    /// last step is still taken: the error of the points is its square, down to the error of the flow.
    double tolerance = 1e-9;
    int maximum_iterations = 40;    ///< Newton steps, > 0
    double minimum_damping = 1e-4;  ///< smallest step length tried, in (0, 1)
    /// A converged orbit whose points moved farther than this (relative to `scale`, see below) is `other_orbit`. > 0;
    /// infinity: any.
    double maximum_distance = 0.1;
    /// Typical size of each coordinate (angle: 2 pi); empty: 2 pi for angles, largest |guess| or 1 otherwise.
    Eigen::VectorXd scale{};
    models::FlowOptions flow{};
};

/// Periodic orbit by multiple shooting with one node per forcing period and damped Newton on all nodes (M7's matrix).
///
/// @param phase     phase of the section [rad].
/// @param guess     shape (n, p): first guess of the points, one per period.
/// @param rotation  turns per orbit, one per angle coordinate; empty: taken from the guess (nearest whole turns of its
/// flow).
/// @param free      parameters for which sensitivities of the points are computed (M7); may be empty.
/// @return orbit with status; everything but status, iterations and residual is meaningful only if converged.
///         `shorter_period`: converged to an orbit whose prime period divides p. Never throws for bad numerics.
/// @throws std::invalid_argument on wrong shapes, nan, or a model that is not forced or a map.
[[nodiscard]] PeriodicOrbit solve_multiple_shooting(const models::System& system, const Eigen::VectorXd& theta,
                                                    double phase, const Eigen::MatrixXd& guess,
                                                    std::span<const int> rotation, std::span<const Eigen::Index> free,
                                                    const ShootingOptions& options = {});

}  // namespace orbid::periodic
