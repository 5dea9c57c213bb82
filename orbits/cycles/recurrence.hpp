#pragma once

#include <cstddef>
#include <vector>

#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// A start for the search of a cycle: a piece of the series that nearly closes, and the number of others beside it.
struct RecurrenceSeed {
    std::size_t start = 0;        ///< point of the series; its p - 1 successors are the other points
    std::size_t recurrences = 0;  ///< recurrent points whose next p points lie beside these, at any shift
};

/// Points that return to their own or a neighbouring box after p sections, grouped into starts.
///
/// Boxes have the edge `box` in scaled units; a point is used when it and all p successors are finite and in one
/// segment. The piece that closes best leads a group. Others join the first leader within 2 boxes (largest coordinate)
/// of all their p points, at any shift along the cycle: about as far as a point can be from the cycle it returns to
/// along a stable direction. With a symmetry, mirrored pieces join the same group.
///
/// @return groups of at least `minimum` points, most recurrences first, then by the leader's index.
/// Cost: O(points + recurrent points x groups nearby).
[[nodiscard]] std::vector<RecurrenceSeed> recurrence_seeds(const SectionPoints& points, int period, double box,
                                                           std::size_t minimum);

}  // namespace orbid::orbits
