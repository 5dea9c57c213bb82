#pragma once

#include "periodic/branches/branch_curve.hpp"
#include "periodic/orbit/orbit.hpp"

namespace orbid::periodic {

/// An orbit on a curve in the reported form. Forced models and maps: one point per period. Autonomous flows: their
/// crossings of the section of the setting, or all nodes without one or where the orbit does not cross it.
[[nodiscard]] PeriodicOrbit reported(const CurvePoint& point);

/// Two orbits are equal up to their beginning: points agree within `tolerance` x scale.
[[nodiscard]] bool same_orbit(const CurvePoint& a, const CurvePoint& b, double tolerance);

/// One is the other's image under the symmetry that the model declares; false without one.
[[nodiscard]] bool mirror_images(const CurvePoint& a, const CurvePoint& b, double tolerance);

/// How far an orbit is from repeating itself before it closes. This is the smallest distance between it and the same
/// orbit begun later, relative to the scale. Infinity for orbits of one period.
[[nodiscard]] double repetition_gap(const CurvePoint& point);

/// How far an orbit is from being its own mirror image; infinity without a symmetry.
[[nodiscard]] double symmetry_gap(const CurvePoint& point);

}  // namespace orbid::periodic
