#pragma once

#include <vector>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/solution/orbit_problem.hpp"

namespace orbid::periodic {

/// A discretised orbit before it is solved.
struct DiscreteStart {
    MatrixXd nodes;              ///< shape (d, N)
    double time = 0.0;           ///< T [s]; iterations of a map
    ClosingError closing;        ///< at the nodes, whole turns not taken off
    std::vector<int> rotation;   ///< turns per angle of the whole orbit; empty: nearest whole turns of the steps
    int iterations = 0;          ///< steps already taken towards the nodes
    std::vector<double> points;  ///< shares of the orbit at which its points are reported; empty: all nodes
};

/// A reported orbit, and the nodes it was computed at.
struct DiscreteSolution {
    PeriodicOrbit orbit;
    MatrixXd nodes;  ///< shape (d, N): the last iterate
};

/// Solves a discretised orbit and reports it: points, Jacobians, multipliers, sensitivities (M7), prime period,
/// distance from the guess. The same for all discretisations. A point that is no node is reached from the node before
/// it by the flow. Further points of an autonomous orbit are reached by its crossing of the section.
///
/// An orbit of an autonomous flow that does not move is an `equilibrium`: within T the field carries the first state no
/// farther than 1e-6 of the scale, and no two are farther apart than that.
[[nodiscard]] DiscreteSolution solve_discrete(const OrbitProblem& problem, const Discretisation& discretisation,
                                              const DiscreteStart& first);

}  // namespace orbid::periodic
