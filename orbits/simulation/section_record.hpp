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

}  // namespace orbid::orbits
