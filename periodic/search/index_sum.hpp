#pragma once

#include <span>
#include <vector>

#include "periodic/orbit/orbit.hpp"

namespace orbid::periodic {

/// Sums of the indices sign det(1 - J^n) over the points with x = f^n(x) of these prime orbits, n = 1, ..., longest.
/// Lefschetz's theorem makes them all equal for a complete list of a continuous map without winding, of a disc or a
/// cylinder into itself. Every stroboscopic section of a damped system is one (the list includes stable orbits and
/// those at rest). The law fails for sections that tear (Lorenz) and maps that points leave. Missing pairs of opposite
/// index, born at a fold, go unnoticed.
[[nodiscard]] std::vector<int> index_sums(std::span<const PeriodicOrbit> orbits, int longest);

}  // namespace orbid::periodic
