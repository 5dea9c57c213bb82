#pragma once

#include <cstddef>
#include <span>

#include "estimator/ranks/collective.hpp"

namespace orbid::estimator {

/// How a problem is spread over ranks: each has blocks of its own, and all have the parameters. A chain of blocks may
/// go on from one rank to the next. Then both have the node between them: it is the last of the one, which has no own
/// rows for it, and the first of the other.
struct Spread {
    Collective* ranks = nullptr;  ///< null: one process has it all
    std::ptrdiff_t before = -1;   ///< block that the previous rank has as well; -1: none
    std::ptrdiff_t after = -1;    ///< block that the next rank has as well; -1: none

    [[nodiscard]] bool alone() const { return ranks == nullptr; }
    /// Whether a block counts on this rank: one that two ranks have counts on the second one.
    [[nodiscard]] bool owns(std::size_t block) const { return static_cast<std::ptrdiff_t>(block) != after; }
    /// Sums over all ranks; alone: nothing changes.
    void sum(std::span<double> values) const {
        if (ranks != nullptr) ranks->sum(values);
    }
    [[nodiscard]] double sum(double value) const {
        sum(std::span<double>(&value, 1));
        return value;
    }
    void sum(Eigen::VectorXd& values) const {
        sum(std::span<double>(values.data(), static_cast<std::size_t>(values.size())));
    }
    [[nodiscard]] bool any(bool value) const { return ranks != nullptr ? ranks->any(value) : value; }
};

}  // namespace orbid::estimator
