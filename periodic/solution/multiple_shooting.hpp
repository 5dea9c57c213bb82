#pragma once

#include <span>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// Periodic orbit by multiple shooting: one node per period of the forcing (iteration, return to the section), and
/// further ones where errors grow too much. Damped Newton on all nodes at once (M7's matrix), and on T of autonomous
/// flows, bordered by the phase condition.
///
/// @param start  points, one per period of the forcing, iteration, or return to the section; or a state and T.
/// @param free   parameters for which sensitivities of the points (and T) are computed (M7); may be empty. Points of
///               autonomous flows: of the crossings, which move along the section; without a section, at fixed shares
///               of T with the first point moving across the flow.
/// @return orbit with status; everything but status, iterations and residual is meaningful only if converged, or where
/// stated.
///         `shorter_period`: converged to an orbit that runs `repeats` times through a shorter one. `other_orbit`:
///         farther from the guess than allowed, or with a rotation other than asked for where there is none with that
///         one. Both hold the orbit found, complete. `equilibrium`: `points` is where. Autonomous flows otherwise:
///         `points` is the last iterate. Never throws for bad numerics.
/// @throws std::invalid_argument on wrong shapes, nan, time <= 0, or a start that does not fit the kind of model.
[[nodiscard]] PeriodicOrbit solve_multiple_shooting(const models::System& system, const Eigen::VectorXd& theta,
                                                    const StartingSolution& start, std::span<const Eigen::Index> free,
                                                    const ShootingOptions& options = {});

/// The same for forced models and maps.
///
/// @param phase     phase of the section [rad].
/// @param guess     shape (n, p): first guess of the points, one per period.
/// @param rotation  turns per orbit, one per angle coordinate; empty: taken from the guess (nearest whole turns of its
/// flow).
/// @throws std::invalid_argument also on a model that is not forced or a map.
[[nodiscard]] PeriodicOrbit solve_multiple_shooting(const models::System& system, const Eigen::VectorXd& theta,
                                                    double phase, const Eigen::MatrixXd& guess,
                                                    std::span<const int> rotation, std::span<const Eigen::Index> free,
                                                    const ShootingOptions& options = {});

}  // namespace orbid::periodic

#pragma GCC visibility pop
