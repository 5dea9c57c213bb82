#pragma once

#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// The readings of one segment and how they were made: the input for the guess of its first state.
struct SegmentReading {
    const Segment& segment;
    std::vector<Eigen::Index> coordinate;  ///< model coordinate of each row of the segment's values; different
    models::Sensor sensor;
    double phase = 0.0;  ///< [rad] of the forcing at the first sample
};

/// A state of the system at the first sample of a segment, good enough to start a fit from. Shape (n).
///
/// Coordinates that are read: value at the first sample (of a local polynomial where it is missing), the instrument
/// inverted by damped Newton steps on System::readings. Unread coordinates: from the slopes of the read ones, so that
/// the readings change as fast as f(x) says (a pendulum with read angle: the angular velocity). This is Gauss-Newton
/// from 0 with differences of f; coordinates on which no slope depends stay 0. Formulas of a sensor mix both kinds: the
/// two steps alternate. A formula that bends back has several inverses: the search begins at
/// the reading itself, taken as a state, or at 1 where the formula has no value there.
///
/// The local polynomial is a cubic over the first samples, as many of 5, 9, 17, 33, 65 as it describes equally well
/// (its residual grows by less than one half from one width to the next): short where the motion curves, long where
/// noise dominates.
///
/// @param theta  shape (q). A segment without any reading of a coordinate leaves it at 0.
[[nodiscard]] Eigen::VectorXd initial_state(const models::System& system, const Eigen::VectorXd& theta,
                                            const SegmentReading& reading);

/// Value and slope [1/s] at times[0] of the cubic described above; nan samples are left out. Angles are followed across
/// the cut of the circle.
struct LocalSlope {
    double value = 0.0;
    double slope = 0.0;
    int samples = 0;  ///< used; 0 when there were none
};
[[nodiscard]] LocalSlope slope_at_start(const Eigen::VectorXd& times, const Eigen::VectorXd& values, bool angle);

}  // namespace orbid::orbits
