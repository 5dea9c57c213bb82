#pragma once

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// The time T in which a cycle closes, and its sd, from the return times near its points:
///
///     T = sum_j tau(x_j),   var T = g' Cov(x) g + sum_j var tau_j,   g_j = d tau / dx at x_j,
///
/// where tau near x_j is a polynomial (order 1 to 3) fitted to the return times of the nearest points of the series,
/// weights (1 - (d / radius)^2)^2. Order and neighbours are those with the smallest product of the residuals' rms and
/// the root of the leverage of the place; var tau_j is the square of that product plus that of the difference to the
/// second-best fit. Neighbours are left out from the first whose image tears away from the nearest neighbour's.
///
/// Leaves time and time_sd nan when the series has no times or a point of the cycle has too few neighbours.
void time_cycle(const SectionPoints& points, const NeighbourIndex& grid, CycleCandidate& draft);

}  // namespace orbid::orbits
