#pragma once

#include <Eigen/Core>

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/sections/section_points.hpp"
#include "orbits/spline_map/spline_map_fit.hpp"

namespace orbid::orbits {

/// A closed orbit of a patch map.
struct SplineMapCycle {
    Eigen::MatrixXd points;  ///< shape (n, p), wrapped
    bool converged = false;
};

/// Newton's method on all points of an orbit together,  F(x_j) = x_{j+1}, j mod p.
///
/// @param start  shape (n, p), scaled units.
/// @return converged = false when it wanders or leaves the region with data.
[[nodiscard]] SplineMapCycle close_on_spline_map(const SectionPoints& section, const SplineMap& map,
                                                 const Eigen::MatrixXd& start);

/// Multipliers of the map along points, shape (n, p), all of them at places with data.
[[nodiscard]] CycleMultipliers multipliers_of(const SplineMap& map, const Eigen::MatrixXd& points);

/// Covariance of all points and of ln|multipliers| of a closed orbit from that of the map's coefficients, to first
/// order:  J dx = -dF(x), with dF = Phi(x) dc, and the jacobians' own errors dPhi/dx dc + F'' dx.
/// @param points  shape (n, p), wrapped.
[[nodiscard]] CycleCandidate draft_of(const SectionPoints& section, const SplineMapFit& fit,
                                      const Eigen::MatrixXd& points);

}  // namespace orbid::orbits
