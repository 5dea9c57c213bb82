#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"
#include "orbits/simulation/state_filter.hpp"

namespace orbid::orbits {

/// States from which the first samples of a record may come, the most likely one first.
struct FirstStates {
    Eigen::MatrixXd states;   ///< shape (n, candidates), at least one column
    Eigen::MatrixXd courses;  ///< shape (n, m): states on courses of the model like the record; at least one
    std::uint64_t work = 0;   ///< as of track_states()
};

/// First states of a record that says less than the state at each instant.
///
/// Unread coordinates are looked for on courses of the model itself: from the state that initial_state() tells, and
/// from 24 others whose unread coordinates are random, between a thirtieth and ten ranges of what is read. Where a
/// course resembles the first readings most, its state is an analogue of the first one (Lorenz 1969). The analogues are
/// improved by Levenberg and Marquardt, over as many samples as errors grow by a factor e, and put in the order of what
/// they leave. No coordinate is 0 by default, so that none begins on an invariant plane.
///
/// @param record  its range is not read.
/// @param first   what is known of the state, shape (n), nan where unknown; or empty.
/// @param sd      shape (rows): of the readings, > 0.
[[nodiscard]] FirstStates first_states(const FollowedRecord& record, const Segment& data, const Eigen::VectorXd& first,
                                       const Eigen::VectorXd& sd);

}  // namespace orbid::orbits
