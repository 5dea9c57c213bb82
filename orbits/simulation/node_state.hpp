#pragma once

#include <span>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// What the phase argument of a system grows by in a second: omega [rad/s] of a forced model, 1 of one with measured
/// inputs (its phase is the time on the clock of the signal), 0 of the others.
[[nodiscard]] double phase_rate(const models::System& system, const Eigen::VectorXd& theta);

/// Phase [rad] of the forcing at a sample of a series: of the section, or series.phase + omega t (with measured inputs:
/// the time on their clock). 0 where phases have no meaning.
[[nodiscard]] double phase_at(const models::System& system, const Eigen::VectorXd& theta, const Series& series,
                              const Segment& segment, Eigen::Index sample);

/// States of a system at samples of a segment, from the readings: the starts of a trajectory's nodes.
///
/// Where every coordinate is read the sensor is inverted at each sample, x <- x + (reading - sensor(x)), which settles
/// within a few rounds for instruments that shift and for a difference quotient over a short delay. Otherwise each
/// sample is the start of the rest of its segment, see initial_state(): unread coordinates follow from slopes, which
/// needs samples in time. A sample without the needed readings gets the state that the flow reaches from the one
/// before; the first of a segment gets that of the next sample that has one.
///
/// @param samples  ascending columns of segment.values.
/// @return shape (n, samples); nan where unknown.
[[nodiscard]] Eigen::MatrixXd node_states(const models::System& system, const Eigen::VectorXd& theta,
                                          const Series& series, std::size_t segment, const models::Sensor& sensor,
                                          std::span<const Eigen::Index> samples);

}  // namespace orbid::orbits
