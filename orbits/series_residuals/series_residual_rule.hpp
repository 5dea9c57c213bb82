#pragma once

#include <stdexcept>
#include <string>

namespace orbid::orbits {

/// @throws std::invalid_argument unless the rule holds.
inline void require_series_rule(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument("series residual: " + message);
}

}  // namespace orbid::orbits
