#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>

#include "models/arithmetic/dual.hpp"
#include "models/definition/parameter.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A hyperplane in the state space, normal . x = offset, crossed in one direction (autonomous flows).
struct SectionPlane {
    std::span<const double> normal;  ///< shape (n)
    double offset = 0.0;
    int direction = 1;  ///< +1: crossings from below (normal . x' > 0), -1: from above
};

}  // namespace orbid::models

#pragma GCC visibility pop

namespace orbid::models {

/// A point of a solution as seen from a plane, g(x) = direction (normal . x - offset).
struct PlaneView {
    double s = 0.0;
    double g = 0.0;
    double slope = 0.0;  ///< dg/ds
    double terms = 0.0;  ///< sum of the terms of g without their signs: what rounding is relative to
};
/// @param f  dx/ds
template <class X, class F>
[[nodiscard]] PlaneView view_from(const SectionPlane& plane, double s, const X& x, const F& f) {
    PlaneView view{s, -plane.offset, 0.0, std::abs(plane.offset)};
    for (std::size_t i = 0; i < plane.normal.size(); ++i) {
        view.g += plane.normal[i] * value_of(x[i]);
        view.terms += std::abs(plane.normal[i] * value_of(x[i]));
        view.slope += plane.normal[i] * value_of(f[i]);
    }
    view.g *= plane.direction;
    view.slope *= plane.direction;
    return view;
}

/// Period of g over which a plane recurs, as angles turn; infinity without angles, and where entries of several angles
/// are not whole multiples of the smallest.
template <class Coordinates>
[[nodiscard]] double turn_of(const SectionPlane& plane, const Coordinates& coordinates) {
    constexpr double none = std::numeric_limits<double>::infinity();
    const auto& normal = plane.normal;
    double smallest = none;
    for (std::size_t i = 0; i < normal.size(); ++i)
        if (coordinates[i].angle && normal[i] != 0.0) smallest = std::min(smallest, std::abs(normal[i]));
    for (std::size_t i = 0; i < normal.size() && smallest < none; ++i) {
        const double multiple = normal[i] / smallest;
        // Entries come from a normalised vector: whole multiples up to a few roundings.
        if (coordinates[i].angle && std::abs(multiple - std::round(multiple)) > 1e-12 * std::abs(multiple)) return none;
    }
    return 2.0 * std::numbers::pi * smallest;
}
/// The recurrence of a plane that is nearest to g.
[[nodiscard]] inline double nearest_level(double g, double turn) {
    return std::isfinite(turn) ? turn * std::round(g / turn) : 0.0;
}

}  // namespace orbid::models
