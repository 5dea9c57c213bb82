#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::orbits {

/// True states at the instants of a record, before any instrument: what the two kinds of plan deliver.
struct StateRecord {
    struct Piece {
        std::size_t trajectory = 0;
        Eigen::MatrixXd states;  ///< shape (n, m)
        Eigen::VectorXd times;   ///< samples, crossings of a plane: shape (m) [s]
    };
    std::vector<Piece> pieces;  ///< by trajectory, then in time
    std::vector<TrajectoryEvent> events;
    bool complete = true;
    std::string message;
};

/// A random state: angles uniform on the circle, other coordinates in +- range. Streams are keyed by trajectory and
/// attempt (0 = the first start).
[[nodiscard]] Eigen::VectorXd random_state(const models::System& system, const Eigen::VectorXd& range,
                                           std::uint64_t seed, std::size_t trajectory, std::size_t attempt);

/// Sections of several trajectories with capture, rest and restarts as `simulate` describes. Options are valid.
/// @param range           shape (n): half the range of random starts, also the measure of capture.
/// @param longest_return  [s], > 0: a trajectory without a crossing for this long is lost; crossings only.
[[nodiscard]] StateRecord record_sections(const models::System& system, const Eigen::VectorXd& theta,
                                          const VirtualExperimentOptions& options, const Eigen::VectorXd& range,
                                          double longest_return);

/// Samples of every trajectory. A trajectory that comes to rest goes on resting: that is reported.
[[nodiscard]] StateRecord record_samples(const models::System& system, const Eigen::VectorXd& theta,
                                         const VirtualExperimentOptions& options, const Eigen::VectorXd& range);

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
