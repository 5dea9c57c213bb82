#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace orbid::models {

/// The value that is number `place` in ascending order: place 0 is the smallest. place < values.size().
[[nodiscard]] inline double ranked(std::vector<double> values, std::size_t place) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(place);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

/// For an even number of values the larger of the two in the middle; 0 for none.
[[nodiscard]] inline double upper_median(std::vector<double> values) {
    const std::size_t middle = values.size() / 2;
    return values.empty() ? 0.0 : ranked(std::move(values), middle);
}

}  // namespace orbid::models
