#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_result.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::identification {

/// Places of a segment where the course misses, and are looked at together with nodes to either side.
struct LinkGap {
    std::size_t place = 0;              ///< of the residual
    std::size_t segment = 0;            ///< among the fitted ones
    std::size_t begin = 0;              ///< block of the segment's first node
    std::vector<Eigen::Index> missed;   ///< nodes whose intervals miss the next one or a reading, ascending
    Eigen::Index first = 0, count = 0;  ///< nodes of the piece
    Eigen::MatrixXd nodes;              ///< of the piece, mended; empty: it was not
    std::size_t left = 0;               ///< places that still miss
};

/// Blocks whose intervals miss the next node by more than three sds of matching, or a reading with normal errors by
/// more than 4.5 of its sds, ascending. All have a next node.
/// @param place  of the residual among all of the estimate.
[[nodiscard]] std::vector<std::size_t> missed_places(const orbits::ShootingResidual& residual,
                                                     const estimator::Estimate& estimate, std::size_t place);

/// Adds the gaps of these blocks, but for those with more than twelve: they are no matter of single states.
/// @param place   of the residual among those by multiple shooting.
/// @param margin  nodes of a piece before and after those that miss; places that are no further apart belong together.
void add_gaps(const orbits::ShootingResidual& residual, const std::vector<std::size_t>& missed, std::size_t place,
              Eigen::Index margin, std::vector<LinkGap>& gaps);

}  // namespace orbid::identification
