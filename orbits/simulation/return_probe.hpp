#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::orbits {

/// Number of trajectories that probe a system.
inline constexpr Eigen::Index probe_count = 16;

/// Their random starts, shape (n, probe_count): angles uniform on the circle, other coordinates in +- half.
[[nodiscard]] Eigen::MatrixXd probe_starts(const models::System& system, const Eigen::VectorXd& half,
                                           std::uint64_t seed);

/// What a few trajectories show about an autonomous flow and a plane.
struct ReturnProbe {
    Eigen::VectorXd range;        ///< shape (n): largest absolute value of each coordinate on the way; pi for angles
    double longest_return = 0.0;  ///< [s]: after this time without a crossing none is expected
};

/// Follows each start over 64 returns to the section.
///
/// The time of a return is not known beforehand. A return may first take ten times the time in which the starts change
/// by their own size. This limit grows tenfold, at most six times, until a quarter of the trajectories deliver all
/// returns. `longest_return` is then 100 times the median of their returns, or without any return the longest time
/// tried. Passing an equilibrium prolongs a return by the logarithm of the distance, which is far less. `range` is 1
/// for a coordinate that stays at 0.
///
/// @param starts  shape (n, m), m > 0: trajectories that explode or settle elsewhere are left out
[[nodiscard]] ReturnProbe probe_returns(const models::System& system, const Eigen::VectorXd& theta,
                                        const models::Section& section, const Eigen::MatrixXd& starts,
                                        const models::FlowOptions& flow);

}  // namespace orbid::orbits
