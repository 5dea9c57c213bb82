#pragma once

#include <limits>
#include <optional>
#include <span>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

/// What fixes the phase of an autonomous orbit, sum_j normals_j . x_j = offset, with x_j the states at the nodes.
/// Solvers may multiply it by a positive factor.
struct PhaseCondition {
    MatrixXd normals;  ///< shape (n, 1): a condition on the first state alone; or (n, N); not 0
    double offset = 0.0;
};

/// The condition on an autonomous orbit near a guess; none for other models. On a section that was named: the first
/// state stays there. Otherwise, by the choice (automatic: plane),
///
///     plane     f(g_0) . (x_0 - g_0) = 0: Poincare's, the plane across the flow through the first state;
///     integral  sum_j h_j f(g_j) . (x_j - g_j) = 0: of all shifts in time of an orbit the one nearest to the guess.
///
/// @param guess   states g_j at the nodes, shape (n, N).
/// @param shares  of the orbit at which they lie, ascending from 0.
/// Source: E. J. Doedel, H. B. Keller, J. P. Kernevez, Int. J. Bifurcation and Chaos 1 (1991) 745 (integral condition).
[[nodiscard]] std::optional<PhaseCondition> phase_condition(const models::System& system, const VectorXd& theta,
                                                            const MatrixXd& guess, std::span<const double> shares,
                                                            const std::optional<models::Section>& section,
                                                            PhaseChoice choice);

/// Where Newton's method ended.
struct NewtonResult {
    OrbitStatus status = OrbitStatus::no_progress;  ///< converged or why not; never other_orbit, shorter_period
    MatrixXd nodes;                                 ///< shape (d, N): the last iterate
    double time = 0.0;                              ///< T of the last iterate, where it is unknown
    int iterations = 0;
    double residual = 0.0;  ///< largest closing error, over nodes and entries
    ClosingError closing;   ///< at the last iterate; where converged, before its last step
    /// Length of the second step, with the old matrix, relative to the first one; infinity where there was none. Below
    /// 1/4 the orbit found is the only one near the guess, judged by these two steps.
    double contraction = std::numeric_limits<double>::infinity();
    double first_step = 0.0;  ///< length of the first one, all nodes and ln T together, in units of the scales
};

/// The equations of a discretised orbit. Everything is kept by reference.
struct DiscreteEquations {
    const Discretisation& discretisation;
    const MatrixXd& turns;                           ///< whole turns per step, shape (d, N)
    const std::optional<PhaseCondition>& condition;  ///< required if and only if T is unknown
    const VectorXd& scale;                           ///< typical size of each entry of z, shape (d), > 0
};

/// Damped Newton on all nodes at once, and on ln T of autonomous orbits. Damping by the natural monotonicity test: a
/// step is accepted when the next one, with the old matrix, is shorter.
///
/// @param start  shape (d, N).
/// @param first  the closing error there, turns taken off.
/// @return result with status converged, no_progress, iteration_limit, not_simulated, singular or period_vanished.
/// Source: P. Deuflhard, Newton Methods for Nonlinear Problems (2004), chapter 3.
[[nodiscard]] NewtonResult newton(const DiscreteEquations& equations, const MatrixXd& start, double time,
                                  ClosingError first, const ShootingOptions& options);

/// Derivatives of the nodes with respect to the free parameters, and of ln T below them, (M7): shape (d N + k, f), k =
/// 1 where T is unknown, 0 otherwise. @param closing  at the solution, with the free parameters.
[[nodiscard]] MatrixXd node_sensitivities(const DiscreteEquations& equations, const ClosingError& closing,
                                          const MatrixXd& nodes, double time, std::span<const Index> free);

}  // namespace orbid::periodic
