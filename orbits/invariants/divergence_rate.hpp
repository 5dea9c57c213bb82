#pragma once

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// How fast neighbours separate.
struct DivergenceRate {
    double rate = 0.0;  ///< per step; nan: distances do not grow over at least 2 steps between alignment and range
    double sd = 0.0;
};

/// Largest Lyapunov exponent from the mean logarithm of the distance between a point and its neighbours after k steps
/// (Rosenstein et al. 1993; Kantz 1994, who averages before taking the logarithm):
///
///     S(k) = < ln |x_{i+k} - x_{j+k}| >,   rate = (S(last) - S(first)) / (last - first)
///
/// `last` is when a tenth of the distances has grown to 10 % of the range, `first` a third of the way there (at least
/// one step), when they have turned into the unstable direction. A cross-check, not a precise value.
/// Neighbours of 20 000 evenly spread points are followed.
[[nodiscard]] DivergenceRate divergence_rate(const SectionPoints& points, const NeighbourIndex& grid);

}  // namespace orbid::orbits
