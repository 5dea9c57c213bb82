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

struct CollocationOptions {
    int stages = 4;        ///< m collocation points per interval, in [1, 10]
    int intervals = 20;    ///< to begin with, per period of the forcing, return to the section, or orbit; >= 2
    int mesh_updates = 2;  ///< times the mesh is moved so that all intervals have the same error; 0: equidistant
    double accuracy =
        1e-10;         ///< wanted error of the points relative to the scale, > 0; intervals are halved until then
    int halvings = 5;  ///< at most so often, >= 0; 0: the first mesh stays, and the error is not estimated (nan)
    ShootingOptions solver{};
};

/// Periodic orbit of a smooth flow by collocation at m Gauss points on each interval of an adaptive mesh. The solution
/// is a continuous piecewise polynomial of degree m that satisfies the equations at the collocation points. The error
/// at the mesh points is O(h^(2 m)).
///
/// The mesh is moved so that all intervals have the same share of the integral of |x^(m+1)|^(1/(m+1)), the error of the
/// polynomials. Then intervals are halved until the error is below `accuracy`. It is estimated as a third of the
/// difference of the points of two meshes: right for order two, far too large where order 2 m is reached. Where a
/// derivative of the equations jumps (v|v| at v = 0), orders above two are lost in the intervals it lies in.
///
/// @param start  as for multiple shooting; forced models and autonomous flows.
/// @return orbit as from multiple shooting; `jacobians` is empty where a point is no mesh point. A discretisation_error
///         above `accuracy` means that no halvings were left.
/// @throws std::invalid_argument for a map, a model that is not smooth at theta, and where multiple shooting does.
/// Cost: O(N m^3 n^3) per iteration, N intervals.
/// Source: U. Ascher, J. Christiansen, R. D. Russell, Mathematics of Computation 33 (1979) 659.
[[nodiscard]] PeriodicOrbit solve_collocation(const models::System& system, const Eigen::VectorXd& theta,
                                              const StartingSolution& start, std::span<const Eigen::Index> free,
                                              const CollocationOptions& options = {});

}  // namespace orbid::periodic

#pragma GCC visibility pop
