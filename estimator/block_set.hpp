#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/residual.hpp"

namespace orbid::estimator {

/// Latent states: per residual, per block (also of blocks that take no part).
using Latents = std::vector<std::vector<Eigen::VectorXd>>;

/// One group of one residual: records with a common error scale s_g.
struct Channel {
    std::size_t residual = 0;
    int group = 0;
};

/// One block that takes part in a minimisation.
struct ActiveBlock {
    std::size_t residual = 0;
    std::size_t block = 0;
    std::vector<int> channel;  ///< of each record, index into the channels of the estimate
    Eigen::Index latents = 0;
    Eigen::MatrixXd cholesky;  ///< lower L, Sigma_b = L L^T; empty = identity
};

/// The set of blocks of one minimisation; it does not change while the objective is minimised (M11).
struct BlockSet {
    std::vector<ActiveBlock> blocks;
    Eigen::VectorXd count;        ///< records of each channel
    Eigen::MatrixXd information;  ///< Fisher information of ln s without latents and parameters, see shape_information
    double ln_det_shapes = 0.0;   ///< sum over blocks of ln|Sigma_b|
    Eigen::Index records = 0;
    Eigen::Index latents = 0;
};

/// All groups of all residuals, in order.
[[nodiscard]] std::vector<Channel> channels_of(const std::vector<Residual*>& residuals);

/// The active blocks of all residuals as they are now.
///
/// Fisher information of ln s_g, ln s_h: sum over blocks of sum_{i in g, j in h} (delta_ij + Sigma_ij (Sigma^-1)_ij),
/// which is 2 n_g on the diagonal for the identity.
///
/// @throws std::invalid_argument naming the block when a shape has the wrong size or is not positive definite, a
///         record names a group that does not exist, or a block without structure has latent states.
[[nodiscard]] BlockSet freeze(const std::vector<Residual*>& residuals, const std::vector<Channel>& channels);

/// Values of the active blocks, in their order.
struct Evaluation {
    std::vector<BlockValue> values;
    std::vector<std::size_t> failed;  ///< indices into BlockSet::blocks; a value that is not finite counts as failed
};

/// Asks every residual once. @throws std::invalid_argument naming the block when an answer has the wrong shape.
[[nodiscard]] Evaluation evaluate(const std::vector<Residual*>& residuals, const BlockSet& set,
                                  const Eigen::VectorXd& theta, const Latents& latents, bool derivatives);

/// w = L^-1 D^-1 a: rows divided by their error, in place. `channel` of each row, `scale` of each channel.
void whiten(const std::vector<int>& channel, const Eigen::MatrixXd& cholesky, const Eigen::VectorXd& scale,
            Eigen::MatrixXd& rows);

}  // namespace orbid::estimator
