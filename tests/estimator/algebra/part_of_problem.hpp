#pragma once

#include <cstddef>
#include <vector>

#include "tests/estimator/problem/stacked_problem.hpp"

namespace orbid::estimator::test {

/// Blocks [begin, end) of a problem whose chains follow each other, and the first block after them if a chain goes on.
inline std::vector<BlockTriangle> part_of(const StackedProblem& problem, std::size_t begin, std::size_t end,
                                          bool goes_on) {
    std::vector<BlockTriangle> whole = problem.blocks();
    std::vector<BlockTriangle> part(whole.begin() + static_cast<std::ptrdiff_t>(begin),
                                    whole.begin() + static_cast<std::ptrdiff_t>(end));
    if (goes_on) {
        const Eigen::Index l = whole[end].latents;
        part.push_back(linked_block(Eigen::MatrixXd(0, l + problem.parameters + 1), l));
    }
    for (BlockTriangle& block : part)
        if (block.next >= 0) block.next -= static_cast<std::ptrdiff_t>(begin);
    return part;
}

}  // namespace orbid::estimator::test
