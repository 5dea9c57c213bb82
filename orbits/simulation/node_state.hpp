#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// Phase [rad] of the forcing at a sample of a series: of the section, or series.phase + omega t (with measured inputs:
/// the time on their clock). 0 where phases mean nothing.
[[nodiscard]] double phase_at(const models::System& system, const Eigen::VectorXd& theta, const Series& series,
                              const Segment& segment, Eigen::Index sample);

/// States of a system at samples of a segment, as the readings say: what nodes of a trajectory start from.
///
/// Where every coordinate is read the sensor is inverted at each sample, x <- x + (reading - sensor(x)), which for
/// instruments that shift and for a difference quotient over a short delay settles within a few rounds. Otherwise each
/// sample is the start of the rest of its segment, see initial_state(): unread coordinates follow from slopes; that
/// takes samples in time. A sample without the readings that are needed has the state to which the flow leads from the
/// one before, and the first of a segment the one of the next sample that has.
///
/// @param samples  ascending columns of segment.values.
/// @return shape (n, samples); nan where nothing can be said.
[[nodiscard]] Eigen::MatrixXd node_states(const models::System& system, const Eigen::VectorXd& theta,
                                          const Series& series, std::size_t segment, const models::Sensor& sensor,
                                          std::span<const Eigen::Index> samples);

}  // namespace orbid::orbits
