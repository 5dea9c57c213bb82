#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::identification {

/// Links of a segment that miss, and are looked at together with nodes to either side.
struct LinkGap {
    std::size_t place = 0;              ///< of the residual
    std::size_t segment = 0;            ///< among the fitted ones
    std::size_t begin = 0;              ///< block of the segment's first node
    std::vector<Eigen::Index> missed;   ///< nodes whose intervals miss the next one, ascending
    Eigen::Index first = 0, count = 0;  ///< nodes of the piece
    Eigen::MatrixXd nodes;              ///< of the piece, mended; empty: it was not
    std::size_t left = 0;               ///< intervals that still miss
};

/// Blocks whose intervals miss the next node by more than three sds of matching, ascending.
[[nodiscard]] std::vector<std::size_t> missed_links(const orbits::ShootingResidual& residual,
                                                    const estimator::ActiveSet& active,
                                                    const std::vector<estimator::BlockValue>& values);

/// Adds the gaps of these links, but for those with more than twelve: they are no matter of single states.
/// @param place  of the residual.
void add_gaps(const orbits::ShootingResidual& residual, const std::vector<std::size_t>& missed, std::size_t place,
              std::vector<LinkGap>& gaps);

}  // namespace orbid::identification
