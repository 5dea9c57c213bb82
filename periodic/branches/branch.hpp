#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/orbit_amplitude.hpp"
#include "periodic/stability/stability.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// One orbit of a branch.
struct BranchPoint {
    double parameter = 0.0;  ///< value of the parameter that is followed
    double arclength = 0.0;  ///< along the branch since its start, in the norm of the continuation
    PeriodicOrbit orbit;     ///< converged; without sensitivities
    int unstable = 0;        ///< multipliers outside the unit circle
    /// The bifurcation at exactly this orbit, solved for together with its condition. `none` on ordinary points.
    Bifurcation bifurcation = Bifurcation::none;
    /// Located bifurcations: estimated error of `parameter` (the last step of the location). 0 on ordinary points.
    double parameter_error = 0.0;
    OrbitAmplitude amplitude{};  ///< of the coordinates; empty when it could not be computed
};

/// Why a branch ended.
enum class BranchEnd {
    bound,          ///< the parameter reached the end of its range; the last point is there
    closed,         ///< back at the start: the branch is a loop
    domain,         ///< the parameter would leave the model's domain
    point_limit,    ///< the number of points asked for
    smallest_step,  ///< no step above the smallest one converges
    equilibrium,    ///< autonomous flows: the orbit shrank to an equilibrium (Hopf)
    period_limit,   ///< autonomous flows: T exceeds `longest`
    other_branch,   ///< met a branch that is known: shrank to half the period (a reverse doubling) or gained symmetry
    not_simulated,  ///< the flow could not be followed
    start,          ///< the start, from which only one direction was asked for
    interrupted     ///< asked to stop
};

[[nodiscard]] std::string_view name(BranchEnd end);

/// A one-parameter family of orbits, in the order of their arclength.
struct Branch {
    Eigen::Index parameter = 0;  ///< index into System::parameters()
    /// Two or more, with bifurcations in their places. A branch that was switched to begins with the orbit it
    /// bifurcates from. One that ends at another branch ends with the orbit they share.
    std::vector<BranchPoint> points;
    BranchEnd first = BranchEnd::bound;  ///< why it ended before points.front()
    BranchEnd last = BranchEnd::bound;   ///< and after points.back()
    /// Where it was switched to: a bifurcation of another branch of the same diagram.
    struct Origin {
        std::size_t branch;
        std::size_t point;
    };
    std::optional<Origin> origin;
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
