#pragma once

#include <span>
#include <variant>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/solution/collocation.hpp"
#include "periodic/solution/finite_difference.hpp"
#include "periodic/solution/multiple_shooting.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// The discretisation, chosen by its options.
using OrbitMethod = std::variant<ShootingOptions, FiniteDifferenceOptions, CollocationOptions>;

/// Periodic orbit by the method that the options belong to: multiple shooting (any model), central finite differences
/// or collocation (smooth flows). Start, result and failures are the same for all, see solve_multiple_shooting().
[[nodiscard]] PeriodicOrbit solve_orbit(const models::System& system, const Eigen::VectorXd& theta,
                                        const StartingSolution& start, std::span<const Eigen::Index> free,
                                        const OrbitMethod& method = ShootingOptions{});

}  // namespace orbid::periodic

#pragma GCC visibility pop
