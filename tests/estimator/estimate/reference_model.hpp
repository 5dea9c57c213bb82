#pragma once

#include <memory>

#include "models/system/system.hpp"

namespace orbid::tests {

/// Bock and Sager's predators x and prey y, their parameters anywhere on the real line (starts at p = 0, steps to
/// p < 0):
///
///     x' = -x + p1 x y,   y' = y - p2 x y
[[nodiscard]] std::shared_ptr<const models::System> bock_system();

/// One compartment with first-order absorption and Michaelis-Menten elimination, D = 30, V = 2:
///
///     a' = -k_a a,   c' = k_a a - (V_m / V) c / (K_m + c),   a(0) = D / V, c(0) = 0
///
/// The concentration c is that of c' = (D / V) k_a exp(-k_a t) - ..., with the dose as a state.
[[nodiscard]] std::shared_ptr<const models::System> michaelis_menten_system();

}  // namespace orbid::tests
