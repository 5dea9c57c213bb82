#pragma once

#include <limits>

namespace orbid::estimator {

/// No bound.
inline constexpr double infinity = std::numeric_limits<double>::infinity();

/// Not determined.
inline constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

}  // namespace orbid::estimator
