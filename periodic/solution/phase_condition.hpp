#pragma once

#include <optional>
#include <span>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"
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

}  // namespace orbid::periodic
