#pragma once

#include <cstddef>

#include "orbits/records/series.hpp"
#include "orbits/sections/sampled_section.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// A plane that was chosen for a sampled motion.
struct ChosenPlane {
    PlaneCrossing crossing;
    std::size_t crossings = 0;
    double mean_return = 0.0;  ///< [s]
    double unevenness = 0.0;   ///< sd of the return times over their mean
};

/// The plane coordinate = value that a motion returns to most evenly.
///
/// Tried are the quantiles of 35, 50 and 65 % of every coordinate that is no angle, or 0 where `zero` says so, in both
/// directions. A crossing passes a band of a fiftieth of the range, or four sds of the errors, to either side. A plane
/// that some turns of the motion miss, or graze, has uneven returns; the map of one with even returns has few branches.
/// So the sd of the return times over their mean is least. Planes with less than half of the crossings of the busiest
/// one are left out.
///
/// @param zero  one per coordinate: the value is 0; empty: quantiles for all
/// @throws std::invalid_argument for sections; DataError for samples that are not equidistant, and where no coordinate
///         crosses its value three times within a segment.
[[nodiscard]] ChosenPlane choose_plane(const Series& samples, const std::vector<bool>& zero = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
