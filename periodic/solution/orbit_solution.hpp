#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"
#include "periodic/solution/newton.hpp"

namespace orbid::periodic {

/// A discretised orbit before it is solved.
struct DiscreteStart {
    Eigen::MatrixXd nodes;       ///< shape (d, N)
    double time = 0.0;           ///< T [s]; iterations of a map
    ClosingError closing;        ///< at the nodes, whole turns not taken off
    std::vector<int> rotation;   ///< turns per angle of the whole orbit; empty: nearest whole turns of the steps
    int iterations = 0;          ///< steps already taken towards the nodes
    std::vector<double> points;  ///< shares of the orbit at which its points are reported; empty: all nodes
};

/// A reported orbit, and the nodes it was computed at.
struct DiscreteSolution {
    PeriodicOrbit orbit;
    Eigen::MatrixXd nodes;  ///< shape (d, N): the last iterate
};

/// Solves a discretised orbit and reports it: points, Jacobians, multipliers, sensitivities (M7), prime period,
/// distance from the guess. The same for all discretisations. A point that is no node is reached from the node before
/// it by the flow. Further points of an autonomous orbit are reached by its crossing of the section.
[[nodiscard]] DiscreteSolution solve_discrete(const models::System& system, const Eigen::VectorXd& theta,
                                              const StartingSolution& start, const Discretisation& discretisation,
                                              const DiscreteStart& first, std::span<const Eigen::Index> free,
                                              const ShootingOptions& options);

/// @throws std::invalid_argument naming the option and its rule.
void validate(const models::System& system, std::span<const Eigen::Index> free, const ShootingOptions& options);

}  // namespace orbid::periodic
