#pragma once

#include <cstdint>

namespace orbid::models {

/// A one-to-one mixing function: every bit of the result depends on every bit of x; 0 stays 0. Source: finalizer of
/// splitmix64 (G. L. Steele, D. Lea, C. H. Flood, OOPSLA 2014).
[[nodiscard]] constexpr std::uint64_t splitmix64_finalizer(std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
    return x ^ (x >> 31);
}

/// The number that splitmix64 draws in state x, used for keys of hash tables and for derived seeds.
[[nodiscard]] constexpr std::uint64_t splitmix64(std::uint64_t x) {
    return splitmix64_finalizer(x + 0x9e3779b97f4a7c15U);
}

}  // namespace orbid::models
