#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// States along a segment of which the readings say only a part at each instant.
struct StateTrack {
    Eigen::MatrixXd states;      ///< shape (n, samples)
    Eigen::VectorXd theta;       ///< shape (q): parameters that suit them
    Eigen::VectorXd reading_sd;  ///< shape (rows of the series): of a prediction over one sample; nan where not read
};

/// Whether the states of a series must be followed: its sensor reads formulas, or it is sampled in time and leaves more
/// coordinates unread than it reads (a slope of each reading determines no more than one). Otherwise node_states()
/// tells states sample by sample.
[[nodiscard]] bool needs_tracking(const models::System& system, const Series& series, const models::Sensor& sensor);

/// States at all samples of a segment, followed from the first to the last and back by a Kalman filter at theta, see
/// followed_states(). Every reading is used for all states, so that a formula that bends back (x^2) is inverted on the
/// same side from one sample to the next.
///
/// The start is the state whose flow reads the first samples best: of 33 candidates, each improved by Levenberg and
/// Marquardt while errors grow by a factor e. Candidates are the state that initial_state() tells, and others along the
/// flow from it. `first` holds what is known of the first state otherwise.
///
/// @param theta  shape (q).
/// @param first  shape (n), nan where unknown; or empty.
/// @param free   parameters of which theta is a guess, good to some twenty percent: they are followed with the state.
/// @param work   grows by what it costs, also where it throws: steps of the integrator, times one more than the
///               directions of its derivatives.
/// @throws DataError  where readings say nothing of the state, or of a direction of it (its sd from all readings of the
///         segment exceeds a thousand ranges): the message names the coordinate
[[nodiscard]] StateTrack track_states(const models::System& system, const Eigen::VectorXd& theta, const Series& series,
                                      std::size_t segment, const models::Sensor& sensor,
                                      const Eigen::VectorXd& first = {}, std::span<const Eigen::Index> free = {},
                                      std::uint64_t* work = nullptr);

/// States at all samples of the segments named, by segment of the series; none at all where nothing must be followed.
/// Parameters are held.
/// @param systems  one per segment of the series, each with its measured inputs, or one in all.
[[nodiscard]] std::vector<Eigen::MatrixXd> followed_series(
    std::span<const std::shared_ptr<const models::System>> systems, const Eigen::VectorXd& theta, const Series& series,
    const models::Sensor& sensor, const std::vector<std::size_t>& segments);

}  // namespace orbid::orbits
