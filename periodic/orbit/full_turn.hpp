#pragma once

#include <numbers>

namespace orbid::periodic {

/// The circle [rad].
inline constexpr double full_turn = 2.0 * std::numbers::pi;

}  // namespace orbid::periodic
