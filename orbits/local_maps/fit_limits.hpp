#pragma once

namespace orbid::orbits {

/// Images this far (in turns) from the image of the nearest neighbour, or of the reference, no longer have a unique
/// representative.
inline constexpr double torn_turns = 0.25;

/// The weight function vanishes at the radius, this much beyond the farthest neighbour, so that it still has weight.
inline constexpr double radius_margin = 1.05;

/// Errors never fall below the rounding of scaled coordinates of order one, with a margin for the few digits that
/// simulation and reading lose.
inline constexpr double scaled_rounding = 1e-14;

/// Variance of rounding in scaled units: keeps every covariance positive definite.
inline constexpr double rounding_variance = 1e-28;

/// Errors are correlated, but the correlation of a few effective residuals is not fully trusted: otherwise a
/// combination would look too good.
inline constexpr double believed_correlation = 0.9;

/// Points of a local fit where neither the job nor the data say how many; a search needs ten times as many.
inline constexpr int default_neighbours = 32;

}  // namespace orbid::orbits
