#pragma once

#include <variant>

#include "estimator/interface/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// How the errors of one coordinate are distributed, apart from their scale.
struct ErrorForm {
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;  ///< least value of an estimated scale, >= 0
    /// The sds of the readings are known (Segment::deviations): the scale is a factor on them.
    bool known_sds = false;
};

/// Whether the errors scale with the size of the reading.
[[nodiscard]] inline bool is_sized(const estimator::ErrorDistribution& distribution) {
    return std::holds_alternative<estimator::LogNormalErrors>(distribution) ||
           std::holds_alternative<estimator::RelativeErrors>(distribution);
}

}  // namespace orbid::orbits

#pragma GCC visibility pop
