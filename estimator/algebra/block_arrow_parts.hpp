#pragma once

#include "estimator/algebra/block_arrow.hpp"

namespace orbid::estimator {

/// Finds the chains that other ranks have parts of, and completes the norms of link columns where two ranks have a
/// block. @throws std::invalid_argument see factorise().
void find_parts(BlockArrow& arrow);

/// Joins chains of all ranks that were factorised with the same damping. @param rest  see PartJoins
[[nodiscard]] std::shared_ptr<const PartJoins> join_chains(
    const BlockArrow& arrow, const std::vector<std::shared_ptr<const ChainFactor>>& chains, Eigen::MatrixXd& rest);

/// The same of the chains without damping, and marks the states that nothing decides.
void join_undamped(BlockArrow& arrow);

}  // namespace orbid::estimator
