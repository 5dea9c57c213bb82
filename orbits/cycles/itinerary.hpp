#pragma once

#include <vector>

#include "orbits/cycles/recurrence.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Starts from wide recurrences: pieces of the series that return within `box` (every coordinate, scaled units), one
/// for each coarse itinerary.
///
/// The itinerary is the sequence of cells of edge `cell` that contain the piece's p points, whichever comes first and,
/// with a symmetry, mirrored or not. Among the pieces of one itinerary the one that closes best is the start;
/// RecurrenceSeed::recurrences counts the others. A point is used when it and all p successors are finite and in one
/// segment.
///
/// Itineraries are distinguished by a 64-bit hash: two in 10^9 pairs of 10^5 itineraries would coincide by accident,
/// which costs a start.
/// @return by the start's index.
/// Cost: O(points + recurrent points (p + log)), memory 16 bytes per recurrent point; parallel, the same with any
/// number of threads.
[[nodiscard]] std::vector<RecurrenceSeed> itinerary_seeds(const SectionPoints& points, int period, double box,
                                                          double cell);

}  // namespace orbid::orbits
