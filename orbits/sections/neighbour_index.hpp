#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/kd_tree.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// A point of the series near the queried place.
struct Neighbour {
    double distance2 = 0.0;   ///< squared Euclidean distance in scaled units
    std::uint32_t index = 0;  ///< of the point in SectionPoints
    bool mirrored = false;    ///< S x, not x, is near
};

/// Nearest neighbours among the points of a series that have an image, periodic in the angles.
///
/// The points are sorted into boxes of a few points each, even if unevenly distributed (KdTree), with coordinates
/// rounded to 1e-9 of their range. Possible nearest points by rounded coordinates are then ranked by exact ones. Any
/// dimension >= 1. Const and thread-safe after construction. Keeps a reference to the points.
///
/// Memory: 4 (n + 1) bytes per point with an image, and about n / 2 for the boxes.
class NeighbourIndex {
public:
    /// @throws std::invalid_argument for more than 2^32 - 2 points.
    /// Cost: O(N log N), parallel.
    explicit NeighbourIndex(const SectionPoints& points);

    /// The k nearest points to a place in scaled units, nearest first, equal distances by index (then unmirrored
    /// first); all points when there are fewer; none for a place that is not finite. With a symmetry mirrored copies
    /// are points too. Asks whether to stop.
    ///
    /// Cost: O(k + log N) for places among the points; O(N) for places far from all points.
    [[nodiscard]] std::vector<Neighbour> nearest(const Eigen::VectorXd& place, std::size_t k) const;

    /// The same into `found`, whose memory is reused.
    void nearest(const Eigen::VectorXd& place, std::size_t k, std::vector<Neighbour>& found) const;

private:
    [[nodiscard]] bool rounded(const double* place, std::uint32_t* result) const;
    [[nodiscard]] double distance2(const double* place, std::uint32_t index) const;
    void sort(std::size_t k, std::vector<Neighbour>& found) const;
    void ask_all(const Eigen::VectorXd& place, std::size_t k, std::vector<Neighbour>& found) const;

    const SectionPoints* points_;
    std::vector<double> origin_;    ///< scaled units: rounds to 0
    std::vector<double> per_unit_;  ///< quanta per scaled unit
    KdTree tree_;
};

}  // namespace orbid::orbits
