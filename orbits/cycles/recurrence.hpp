#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// A start for the search of a cycle: a piece of the series that nearly closes, and the number of others beside it.
struct RecurrenceSeed {
    std::size_t start = 0;        ///< point of the series; its p - 1 successors are the other points
    std::size_t recurrences = 0;  ///< recurrent points whose next p points lie beside these, at any shift
};

/// The points of a start, shape (n, period).
[[nodiscard]] inline Eigen::Map<const Eigen::MatrixXd> seed_points(const SectionPoints& points,
                                                                   const RecurrenceSeed& seed, int period) {
    return {points.point(seed.start), points.dimension(), period};
}

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
