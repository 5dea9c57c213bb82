#pragma once

#include <cstdint>

namespace orbid::models {

/// A number of which every bit depends on every bit of x, one to one; 0 stays 0.
/// Source: finalizer of splitmix64 (G. L. Steele, D. Lea, C. H. Flood, OOPSLA 2014).
[[nodiscard]] constexpr std::uint64_t splitmix64_finalizer(std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
    return x ^ (x >> 31);
}

/// The number that splitmix64 draws in state x: for keys of hash tables and seeds made of seeds.
[[nodiscard]] constexpr std::uint64_t splitmix64(std::uint64_t x) {
    return splitmix64_finalizer(x + 0x9e3779b97f4a7c15U);
}

}  // namespace orbid::models
