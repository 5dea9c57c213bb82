#pragma once

#include <cmath>
#include <cstddef>

#include "estimator/interface/not_finite.hpp"

namespace orbid::apps {

/// Root of the mean of `count` squares, from their sum; nan without any.
[[nodiscard]] inline double root_mean_square(double squares, std::size_t count) {
    return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : estimator::nan_value;
}

}  // namespace orbid::apps
