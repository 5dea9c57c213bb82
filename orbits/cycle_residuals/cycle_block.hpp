#pragma once

#include <vector>

#include <tbb/parallel_for.h>
#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/system/left_loop.hpp"
#include "models/system/system.hpp"
#include "orbits/simulation/section_map.hpp"

namespace orbid::orbits {

/// The values of all active blocks, sequential or parallel: value(b, block) fills block b and returns false when it
/// cannot be evaluated. If a parameter is outside its domain all fail.
/// @param values  full parameter vector of the system.
template <typename Value>
std::vector<estimator::BlockValue> evaluate_blocks(const models::System& system, const Eigen::VectorXd& values,
                                                   const std::vector<estimator::BlockLayout>& layout,
                                                   const Value& value) {
    std::vector<estimator::BlockValue> result(layout.size());
    const bool allowed = values.allFinite() && in_domain(system, values);
    tbb::parallel_for(std::size_t{0}, layout.size(), [&](std::size_t b) {
        if (!layout[b].active) return;
        if (!allowed || !value(b, result[b])) result[b].status = estimator::BlockStatus::failed;
    });
    models::stop_if_left();
    return result;
}

}  // namespace orbid::orbits
