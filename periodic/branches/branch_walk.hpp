#pragma once

#include <cstddef>
#include <vector>

#include "periodic/branches/branch.hpp"
#include "periodic/branches/branch_curve.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::periodic {

/// Two solutions that agree to this share of the scale are one. Located points are good to 1e-9 or better.
inline constexpr double same_solution = 1e-6;

/// Where the parameter may go, and what it means to be there.
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
};

struct Walk {
    std::vector<WalkPoint> points;  ///< the start not among them
    BranchEnd end = BranchEnd::smallest_step;
};

/// Follows a curve from a point on it, in the direction of its tangent.
///
/// Predictor: the cubic through the last two points and their tangents. Corrector: Newton's method on the plane across
/// the cubic. The step is the longest one for which Newton's steps shrink by the factor wanted (the contraction does
/// not depend on how the equations are scaled), the tangent turns by no more than wanted and no multiplier moves too
/// far. Bifurcations that are passed are located; segments over which errors grow too much get further nodes, the
/// phase condition of an autonomous flow moves on when the orbit has turned away from it.
///
/// @param first_step  length of the first step.
/// @param most        number of points, >= 1.
/// Source: P. Deuflhard, B. Fiedler, P. Kunkel, SIAM J. Numer. Anal. 24 (1987) 912 (step control by contraction).
[[nodiscard]] Walk walked(const CurvePoint& start, const ParameterRange& range, const ContinuationOptions& options,
                          double first_step, std::size_t most);

}  // namespace orbid::periodic
