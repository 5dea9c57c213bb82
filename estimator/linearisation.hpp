#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/arrow.hpp"
#include "estimator/block_set.hpp"
#include "estimator/coordinate.hpp"

namespace orbid::estimator {

/// Rows [de/dz | de/du | e] of one block, not yet divided by the errors.
///
/// Without a covariance shape the rows of each channel are replaced by the triangle of their orthogonal factorisation:
/// all sums of squares and products within a channel stay the same, and so does everything (M8)-(M11) needs of them
/// for any error scale, at a cost that no longer depends on the number of records.
struct BlockRows {
    Eigen::MatrixXd rows;  ///< shape (rows, latents + columns + 1)
    std::vector<int> channel;
    Eigen::Index latents = 0;
    const Eigen::MatrixXd* cholesky = nullptr;  ///< of the covariance shape, empty = identity; owned by the BlockSet
};

/// Rows of all active blocks at theta (natural units), derivatives with respect to the coordinates u. Compressed unless
/// told otherwise (clusters of records need them all).
[[nodiscard]] std::vector<BlockRows> linearise(const BlockSet& set, const std::vector<BlockValue>& values,
                                               const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta,
                                               bool compressed = true);

/// The same rows in other parameters y, u = u_0 + basis y: shape of basis (parameters, columns).
[[nodiscard]] std::vector<BlockRows> in_basis(const std::vector<BlockRows>& rows, const Eigen::MatrixXd& basis);

/// One block's rows divided by the errors.
[[nodiscard]] Eigen::MatrixXd whitened(const BlockRows& block, const Eigen::VectorXd& scale);

/// All blocks divided by the errors and factorised.
[[nodiscard]] Arrow whitened_arrow(const std::vector<BlockRows>& rows, const Eigen::VectorXd& scale);

}  // namespace orbid::estimator
