#pragma once

#include <span>
#include <vector>

#include "periodic/orbit/orbit.hpp"

namespace orbid::periodic {

/// Sums of the indices sign det(1 - J^n) over the points with x = f^n(x) of these prime orbits, n = 1, ..., longest.
/// By Lefschetz's theorem they are all the same for a complete list of a continuous map of the section that winds
/// nothing up: a disc or a cylinder into itself, as every stroboscopic section of a damped system (stable orbits and
/// those at rest belong to the list). Sections that tear (Lorenz) and maps under which points leave obey no such law.
/// Orbits that come in pairs of opposite index, born at a fold, can be missing unnoticed.
[[nodiscard]] std::vector<int> index_sums(std::span<const PeriodicOrbit> orbits, int longest);

}  // namespace orbid::periodic
