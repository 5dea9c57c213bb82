#pragma once

#include <optional>

#include <Eigen/Core>

#include "orbits/sections/section_points.hpp"
#include "orbits/spline_map/spline_map_fit.hpp"

namespace orbid::orbits {

/// The points of which a map is made, where not all are useful: of angles whose turns must be told. With more points
/// the map begins to follow those whose turns are told wrong. Empty: all are useful.
///
/// @param reading_covariance  S, shape (n, n), scaled units; so below.
[[nodiscard]] std::optional<SectionPoints> useful_stretch(const SectionPoints& section,
                                                          const Eigen::MatrixXd& reading_covariance);

/// A map (which refers to the section) of patches 1.5 times as wide as those of the finest one, by stages that smooth
/// the points step by step.
///
/// Where errors grow to half a turn, the turns that one part of a record tells may be wrong in places. Of a long record
/// whose turns must be told four parts have maps of their own. The one begins that differs least from the others, where
/// their courses were.
[[nodiscard]] SplineMapFit coarse_spline_map(const SectionPoints& section, const Eigen::MatrixXd& reading_covariance);

/// The finest map, which refers to the section. Not usable if the coarse one is not.
[[nodiscard]] SplineMapFit fine_spline_map(const SectionPoints& section, const SplineMapFit& coarse,
                                           const Eigen::MatrixXd& reading_covariance);

}  // namespace orbid::orbits
