#pragma once

#include <string>

#include "estimator/interface/estimate_result.hpp"

namespace orbid::apps {

/// Scale of a group; null when the estimate has none.
[[nodiscard]] inline const estimator::EstimatedScale* scale_of(const estimator::Estimate& estimate,
                                                               const std::string& group) {
    for (const auto& scale : estimate.scales)
        if (scale.group == group) return &scale;
    return nullptr;
}

}  // namespace orbid::apps
