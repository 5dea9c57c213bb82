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

/// A direction in the space of a branch.
struct BranchDirection {
    Eigen::MatrixXd points;  ///< of the points of the starting solution, shape (n, p)
    double ln_time = 0.0;    ///< of ln T (autonomous flows)
    double parameter = 0.0;  ///< of the parameter
};

/// An orbit of a branch, and the value of the parameter that belongs to it.
struct BranchOrbit {
    PeriodicOrbit orbit;
    double parameter = 0.0;
    Eigen::RowVectorXd parameter_sensitivities;  ///< in the columns of `orbit.sensitivities`
};

/// The orbit of a branch on the plane through a guess across a direction, the parameter being unknown: also at a fold,
/// where none of a given parameter can be solved for. Flows; limit cycles without a section.
///
/// Its sensitivities have one column per free parameter, for moves within the plane across the branch, and one more:
/// the branch's tangent, which has a norm of about one in units of the scale, ln T and `range`.
///
/// @param theta      shape (q); the entry `parameter` is the guess of it.
/// @param free       parameters, not `parameter` itself.
/// @param range      unit of the parameter, > 0.
/// @return status converged, not_simulated, singular or no_progress; `distance` of the whole orbit from the guess
[[nodiscard]] BranchOrbit orbit_across(const models::System& system, const Eigen::VectorXd& theta,
                                       Eigen::Index parameter, double range, const StartingSolution& start,
                                       const BranchDirection& direction, std::span<const Eigen::Index> free,
                                       const ShootingOptions& options);

}  // namespace orbid::periodic

#pragma GCC visibility pop
