#pragma once

#include <vector>

namespace orbid::orbits {

/// The middle one of the values in ascending order, of an even number the upper of the two; 0 without values.
[[nodiscard]] double upper_median(std::vector<double> values);

}  // namespace orbid::orbits
