#pragma once

#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"

namespace orbid::periodic {

/// A piece of p points after which a trajectory comes back near its beginning.
struct RecurrenceStart {
    std::size_t piece = 0;  ///< index into SectionPieces::pieces
    Index first = 0;
    double gap = 0.0;  ///< largest coordinate of x_{t+p} - x_t, relative to the size

    [[nodiscard]] MatrixXd points(const SectionPieces& pieces, int period) const {
        return pieces.pieces[piece].middleCols(first, period);
    }
};

/// Pieces of trajectories that return within `box` (every coordinate, relative to the size), closest first. Each coarse
/// itinerary gives the one that closes best. An itinerary is the cyclic sequence of cells of edge `cell` that the
/// points lie in.
///
/// @param signs  of a symmetry that maps the section onto itself: an itinerary and its mirror image are one; or empty.
/// Cost: O(points p); ties in the order of the pieces, so that the list is the same with any number of threads.
[[nodiscard]] std::vector<RecurrenceStart> recurrence_starts(const models::System& system, const SectionPieces& pieces,
                                                             int period, double box, double cell,
                                                             const std::vector<double>& signs);

}  // namespace orbid::periodic
