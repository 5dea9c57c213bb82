#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/branches/branch.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

struct ContinuationOptions {
    Eigen::Index parameter = 0;  ///< index into System::parameters()
    double lower = 0.0;          ///< range of its values, lower < upper; the start lies inside
    double upper = 0.0;
    /// +1: the branch that leaves the start towards larger values, -1: towards smaller ones, 0: both ways.
    int direction = 0;
    /// Arclength: points relative to the scales and the parameter relative to (upper - lower), each with the weight of
    /// one coordinate. The scales are the solver's, by default 2 pi for angles and the largest value along the orbit
    /// for the others; they are enlarged when an orbit grows to three times that. All > 0.
    double first_step = 1e-2;
    double smallest_step = 1e-7;
    double largest_step = 5e-2;
    std::size_t maximum_points = 1000;  ///< per branch, bifurcations included
    bool switch_doublings = true;       ///< follow the branch of twice the period that begins at a doubling
    bool switch_symmetry = true;        ///< and the asymmetric ones where an orbit loses its symmetry
    int maximum_period = 16;  ///< no branch of a longer period is followed; periods of the forcing, or returns
    std::size_t maximum_branches = 32;
    double longest = 1e6;                 ///< T [s] beyond which a branch of an autonomous flow ends
    std::function<bool()> interrupted{};  ///< asked before every step; empty: never
    ShootingOptions solver{};
    /// Called before every step with the points of this way along the branch so far, and the parameter; empty: never.
    std::function<void(std::size_t points, double parameter)> progress{};
};

struct BifurcationDiagram {
    OrbitStatus start_status = OrbitStatus::no_progress;  ///< converged, or why there is no branch
    std::vector<Branch> branches;                         ///< the first one through the start, then those switched to
};

/// The branch through an orbit, by pseudo-arclength continuation of multiple shooting. Also, generation after
/// generation, the branches that begin at its doublings and symmetry breakings. Folds are passed. Bifurcations are
/// located: each is solved for together with its orbit, to the accuracy of the flow. No branch is followed twice:
/// neither from its other end, nor as its own mirror image (models that declare a symmetry).
///
/// @param start  leads to an orbit at theta by solve_multiple_shooting().
/// @return no branches when the start does not converge; `start_status` then gives its outcome. Never throws for
///         numerical failures: every branch says why it ended.
/// @throws std::invalid_argument naming the option and its rule; models::Stopped if the system asks for a stop before
///         the first branch has taken one step each way. Later stops return the points found until then.
/// Source: H. B. Keller, in: Applications of Bifurcation Theory (1977) 359 (pseudo-arclength).
[[nodiscard]] BifurcationDiagram follow_branches(const models::System& system, const Eigen::VectorXd& theta,
                                                 const StartingSolution& start, const ContinuationOptions& options);

/// Ratios (l_k - l_{k-1}) / (l_{k+1} - l_k) of the successive period doublings l_1, l_2, ... of a cascade, in the order
/// of the periods. Their limit is Feigenbaum's constant 4.669.
[[nodiscard]] std::vector<double> doubling_ratios(std::span<const double> doublings);

}  // namespace orbid::periodic

#pragma GCC visibility pop
