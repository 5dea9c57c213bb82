#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/block_arrow.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// How the best latent states follow the parameters around a minimum, to first order: d z / d u of every block. It
/// needs far less memory than the factors that it is made from.
class LatentCourse {
public:
    LatentCourse(const BlockArrow& arrow, const ReducedProblem& reduced_problem);

    /// Adds what follows a step d of the parameters, shape (q), to the latent states of the set's blocks.
    void follow(const Eigen::VectorXd& d, const BlockSet& set, Latents& latents) const;

    /// Slopes by one parameter, one vector per block.
    [[nodiscard]] std::vector<Eigen::VectorXd> along(Eigen::Index parameter) const;

private:
    std::vector<Eigen::Index> count_;  ///< latent states of each block
    Eigen::MatrixXd slopes_;           ///< shape (q, latent states of all blocks)
};

}  // namespace orbid::estimator
