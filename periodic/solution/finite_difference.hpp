#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

struct FiniteDifferenceOptions {
    /// Nodes per period of the forcing, or return to the section, or orbit; >= 5. The centred differences of a
    /// first-order system add one where the total is even.
    int nodes = 200;
    bool second_order = true;    ///< Fey's scheme where the equations have that structure
    bool estimate_error = true;  ///< solves with half as many nodes as well, for `discretisation_error`; else nan
    ShootingOptions solver{};
};

/// Which coordinate is the velocity of which: velocity[i] >= 0 where x_i' = x_velocity[i], -1 otherwise. Complete:
/// every coordinate is a position or a velocity, and no velocity is shared.
struct SecondOrderStructure {
    std::vector<Eigen::Index> velocity;
    bool complete = false;
};

/// Derived from the equations: x_i' equals x_j bit by bit at the given states and at scattered ones around them, which
/// no other expression does.
[[nodiscard]] SecondOrderStructure second_order_structure(const models::System& system, const Eigen::VectorXd& theta,
                                                          const Eigen::MatrixXd& states, const Eigen::VectorXd& scale);

/// Periodic orbit of a smooth flow by central differences on N equidistant nodes, h = T / N. With second-order
/// structure q' = v, v' = a(q, v, t), Fey's scheme:
///
///     (q_{k+1} - 2 q_k + q_{k-1}) / h^2 = a(q_k, v_k, t_k),   v_k = (q_{k+1} - q_{k-1}) / (2 h),   k mod N
///
/// and otherwise, N odd (for even N the difference operator also annihilates the sawtooth (-1)^k),
///
///     (x_{k+1} - x_{k-1}) / (2 h) = f(x_k, t_k),   k mod N.
///
/// Newton on all nodes at once. The error of a converged orbit and of its multipliers is O(h^2). Sensitivities are
/// those of the discrete orbit, exact but for rounding.
///
/// @param start  as for multiple shooting; forced models and autonomous flows.
/// @return orbit as from multiple shooting. `jacobians` is empty where a point is no node; with the first-order scheme
///         X_j is one of the trapezoidal rule.
/// @throws std::invalid_argument for a map, a model that is not smooth at theta, and where multiple shooting does.
/// Cost: one structured factorisation per iteration, linear in N.
/// Source: Taylor expansion of q(t + h) +- q(t - h).
[[nodiscard]] PeriodicOrbit solve_finite_difference(const models::System& system, const Eigen::VectorXd& theta,
                                                    const StartingSolution& start, std::span<const Eigen::Index> free,
                                                    const FiniteDifferenceOptions& options = {});

}  // namespace orbid::periodic

#pragma GCC visibility pop
