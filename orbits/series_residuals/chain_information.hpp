#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"

namespace orbid::orbits {

/// Of a chain with normal errors: the states that fit best, and how well they are determined.
struct ChainInformation {
    double half_ln_determinant = 0.0;   ///< of the information H of all latent states
    std::vector<Eigen::VectorXd> step;  ///< per block: from the present states to the best ones, by Gauss and Newton
};

/// By orthogonal elimination, one block after the other. Blocks that are not active have no states.
/// @param values  with derivatives, of all active blocks.
/// @param scales  of the groups, shape (groups).
[[nodiscard]] ChainInformation chain_information(const std::vector<estimator::BlockLayout>& layout,
                                                 const std::vector<estimator::BlockValue>& values,
                                                 const Eigen::VectorXd& scales);

}  // namespace orbid::orbits
