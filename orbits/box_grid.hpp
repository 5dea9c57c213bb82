#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "orbits/section_points.hpp"

namespace orbid::orbits {

/// A point of the series near a place that was asked about.
struct Neighbour {
    double distance2 = 0.0;   ///< squared Euclidean distance in scaled units
    std::uint32_t index = 0;  ///< of the point in SectionPoints
    bool mirrored = false;    ///< it is S x, not x, that is near
};

/// Nearest neighbours among the points of a series that have an image, periodic in the angles.
///
/// Points are sorted into boxes (counting sort) of equal size over at most three coordinates; a query looks at rings
/// of boxes around its own until no point outside can be nearer than those found. Any dimension >= 1 is exact; above
/// three coordinates the boxes help less. Const and thread-safe after construction. Keeps a reference to the points.
class BoxGrid {
public:
    /// @throws std::invalid_argument for more than 2^32 - 1 points.
    explicit BoxGrid(const SectionPoints& points);

    /// The k nearest points to a place in scaled units, nearest first, equal distances by index (then unmirrored
    /// first); all points when there are fewer. With a symmetry the mirrored copies count as points too.
    ///
    /// Cost: O(k + points of the boxes visited).
    [[nodiscard]] std::vector<Neighbour> nearest(const Eigen::VectorXd& place, std::size_t k) const;

private:
    static constexpr std::size_t maximum_gridded = 3;

    void collect(const Eigen::VectorXd& place, std::size_t k, bool mirrored, std::vector<Neighbour>& found) const;

    const SectionPoints* points_;
    std::size_t gridded_ = 0;  ///< coordinates that the boxes divide
    std::array<std::int64_t, maximum_gridded> boxes_{1, 1, 1};
    std::array<double, maximum_gridded> origin_{};
    std::array<double, maximum_gridded> size_{1.0, 1.0, 1.0};  ///< edge of a box, scaled units
    std::vector<std::uint32_t> first_;                         ///< first point of each box, one more entry than boxes
    std::vector<std::uint32_t> order_;                         ///< point indices in the order of boxes
    std::vector<double> sorted_;  ///< the points in that order: neighbours lie together in memory
};

}  // namespace orbid::orbits
