#pragma once

#include <cstddef>
#include <vector>

#include "periodic/branches/branch.hpp"
#include "periodic/branches/branch_curve.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::periodic {

/// Two solutions that agree to this fraction of the scale are one. Located points are accurate to 1e-9 or better.
inline constexpr double same_solution = 1e-6;

/// Bounds of the parameter, and why a branch ends at each.
struct ParameterRange {
    double lower = 0.0;
    double upper = 0.0;
    BranchEnd lower_end = BranchEnd::bound;
    BranchEnd upper_end = BranchEnd::bound;
};

/// A point of a walk.
struct WalkPoint {
    CurvePoint point;
    Bifurcation bifurcation = Bifurcation::none;
    double parameter_error = 0.0;
    double arclength = 0.0;  ///< since the start of the walk
    // Computed while the flow may still be asked for, so that a branch that is left is whole so far:
    PeriodicOrbit orbit = {};
    OrbitAmplitude amplitude = {};
};

/// The point with its orbit as it is reported, and how far the coordinates move along it.
[[nodiscard]] WalkPoint described(WalkPoint point);

struct Walk {
    std::vector<WalkPoint> points;  ///< the start not among them
    BranchEnd end = BranchEnd::smallest_step;
};

/// Follows a curve from a point on it, in the direction of its tangent.
///
/// Predictor: the cubic through the last two points and their tangents. Corrector: Newton's method on the plane across
/// the cubic. The step is the longest one that meets three limits: Newton's steps shrink by the factor wanted, the
/// tangent does not turn by too much, and no multiplier moves too far. (The contraction does not depend on the scaling
/// of the equations.) Bifurcations on the way are located. Segments over which errors grow too much get further nodes.
/// The phase condition of an autonomous flow is renewed when the orbit has turned away from it.
///
/// @param first_step  length of the first step.
/// @param most        number of points, >= 1.
/// Source: P. Deuflhard, B. Fiedler, P. Kunkel, SIAM J. Numer. Anal. 24 (1987) 912 (step control by contraction).
[[nodiscard]] Walk walked(const CurvePoint& start, const ParameterRange& range, const ContinuationOptions& options,
                          double first_step, std::size_t most);

}  // namespace orbid::periodic
