#pragma once

#include <algorithm>

#include "models/arithmetic/cubic_zero.hpp"

namespace orbid::models {

/// What one step tells about the velocity along its side, which is > 0 until the switching surface is met.
struct SpeedOverStep {
    double v0, v1;                 ///< at its ends
    double first_rise, last_rise;  ///< acceleration there times duration
    double moved;                  ///< mean: way of the position over duration
};
enum class SurfaceMeeting { none, once, unclear };

[[nodiscard]] inline SurfaceMeeting meeting_within(const SpeedOverStep& v) {
    if (v.v1 < 0.0 && v.v0 > 0.0) return SurfaceMeeting::once;
    if (!(v.v1 > 0.0)) return SurfaceMeeting::unclear;
    // Slower in between than at both ends: two crossings may hide in the step. The tangents bound the dip of a convex
    // curve. A dip is accepted only if it stays above half of the smaller end.
    if (!(v.first_rise < 0.0 && v.last_rise > 0.0)) return SurfaceMeeting::none;
    const double meet = std::clamp((v.v1 - v.v0 - v.last_rise) / (v.first_rise - v.last_rise), 0.0, 1.0);
    return v.v0 + v.first_rise * meet > 0.5 * std::min(v.v0, v.v1) ? SurfaceMeeting::none : SurfaceMeeting::unclear;
}

/// The fraction of the step after which a surface that is met once is met: a guess.
[[nodiscard]] inline double part_before_meeting(const SpeedOverStep& v) {
    return quartic_zero(v.v0, v.v1, v.first_rise, v.last_rise, v.moved);
}

}  // namespace orbid::models
