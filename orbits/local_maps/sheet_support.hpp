#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Neighbours of a place, nearest first, and what they are mapped to.
struct SheetSupport {
    Eigen::VectorXd centre;          ///< the place, wrapped
    Eigen::VectorXd reference;       ///< images are differences to it
    Eigen::MatrixXd z;               ///< shape (k, n), in reading errors
    Eigen::MatrixXd values;          ///< shape (k, n + 1): images, scaled units, and return times
    std::vector<Neighbour> members;  ///< those that do not tear away
    std::vector<Eigen::Index> kept;  ///< of the first i + 1 neighbours so many do not tear away
};

/// @param whitening   L^-1, shape (n, n): L L' is the covariance of a point's errors, scaled units.
/// @param neighbours  at most so many.
[[nodiscard]] SheetSupport sheet_support(const SectionPoints& points, const NeighbourIndex& grid,
                                         const Eigen::MatrixXd& whitening, const Eigen::VectorXd& place,
                                         std::size_t neighbours);

}  // namespace orbid::orbits
