#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Record of states at a phase of the forcing, of iterates of a map, or of crossings of a plane by an autonomous flow.
struct SectionPlan {
    std::size_t sections = 0;     ///< of all trajectories together, > 0; spread over them as evenly as possible
    std::size_t transient = 300;  ///< sections left out at every start and restart; the start itself is the first,
                                  ///< but no crossing of a plane
    /// Of an autonomous flow, and only there. The record keeps the times of the crossings, since the start or restart.
    std::optional<models::Section> section = {};
    /// [s], > 0: without a crossing for so long a trajectory is at rest or cannot be continued. 0: 100 times the median
    /// return of a few trajectories, see probe_returns().
    double longest_return = 0.0;
};

/// Record of samples in time.
struct SamplePlan {
    double step = 0.0;          ///< [s], > 0
    std::size_t count = 0;      ///< samples of each trajectory, > 0
    std::size_t transient = 0;  ///< sampling intervals left out at the start; times count from the start
};

/// What happens to a trajectory that runs into a stable periodic orbit, comes to rest or cannot be continued: nothing
/// more is learnt from it. Sections only; trajectories of samples are never restarted.
enum class Restart { when_captured_or_at_rest, never };

struct VirtualExperimentOptions {
    std::variant<SectionPlan, SamplePlan> plan;
    std::size_t trajectories = 1;  ///< > 0; one segment each, and one more for every restart
    /// Shape (n, trajectories): one start per trajectory. Empty (0 columns): random starts, angles uniform on the
    /// circle, other coordinates uniform in +- random_range.
    Eigen::MatrixXd initial;
    /// Shape (n), > 0 for coordinates that are no angles. Empty: typical_range(), or what 16 trajectories from random
    /// starts within one unit reach in 64 returns to a plane.
    Eigen::VectorXd random_range;
    Restart restart = Restart::when_captured_or_at_rest;
    /// [rad] of the section; samples: of the forcing at time 0; with measured inputs the time [s] of the start on the
    /// clock of their signal.
    double phase = 0.0;
    models::Sensor sensor;  ///< what is recorded of a state
    /// Shape (n): sd of the normal error of a reading, >= 0, in the coordinate's unit. Empty: none. With an
    /// angle_difference sensor the error of an angle reading enters the angle once and the difference twice, and the
    /// rate has none of its own (its entry must be 0).
    Eigen::VectorXd noise;
    /// Shape (n): errors of successive readings of a segment are a stationary first-order autoregression with this
    /// correlation, in (-1, 1), and the sd of `noise`. Empty: independent. 0 for an angle_difference sensor.
    Eigen::VectorXd noise_correlation;
    std::uint64_t seed = 0;
    models::FlowOptions flow;
};

/// Something that happened to a trajectory beside running on.
struct TrajectoryEvent {
    enum class Kind { captured, at_rest, failed, restarted };
    Kind kind = Kind::captured;
    std::size_t trajectory = 0;
    std::size_t section = 0;  ///< sections (samples) since the trajectory's very first start, transients included
    int period = 0;           ///< captured: sections until the orbit repeats
    models::FlowStatus status = models::FlowStatus::ok;  ///< failed: why; at_rest: no_crossing where that ended it
    Eigen::VectorXd state;  ///< shape (n): a point of the orbit, the place of rest, the last state; the new start
};
[[nodiscard]] std::string_view name(TrajectoryEvent::Kind kind);

struct VirtualExperiment {
    Series series;  ///< coordinates as the system names them; formulas of the sensor are no angles
    std::vector<TrajectoryEvent> events;  ///< by trajectory, then by section
    bool complete = true;                 ///< every trajectory delivered all its points
    std::string message;                  ///< why not, when it is not complete
};

/// Simulates a record of a system as an experiment would take it: trajectories after a transient, read by a sensor with
/// normal errors, the angle then rounded to the sensor's step (Sensor::rounding).
///
/// A trajectory of sections counts as captured by a stable orbit of period p <= 64 when its last 256 sections repeat
/// after p within 1e-9 of each coordinate's range. (Rounding, 1e-16, drives a trajectory off an unstable orbit in that
/// time unless its largest multiplier is below 1.065 per section.) What it recorded after it had settled is cut off
/// when it is restarted, from a new random state with a new transient, in a new segment; a trajectory that is lost 20
/// times before it delivers one point is given up (complete = false). With Restart::never everything is kept and the
/// event only reported; a trajectory that cannot be continued then ends early. A flow that meets its plane no more is
/// at rest when it has settled on an equilibrium by the longest return time (event at_rest with status no_crossing),
/// and has failed otherwise.
///
/// Random numbers come from counter-based streams keyed by (seed, purpose, index): the same bytes with any number of
/// threads. Parallel over trajectories, for noise over segments.
///
/// @param theta  shape (q), all parameters of the system.
/// @throws std::invalid_argument naming value and rule: wrong shapes, nothing to record, an autonomous flow without a
///         plane or another system with one, a plane for measured inputs (they tell the time), negative noise, noise on
///         a rate that is a difference of readings, starts that are not finite.
[[nodiscard]] VirtualExperiment simulate(const models::System& system, const Eigen::VectorXd& theta,
                                         const VirtualExperimentOptions& options);

/// Half the range of random starts, shape (n): pi for angles; otherwise the largest absolute value that 16 trajectories
/// reach, started at random on the circle of every angle and in [-1, 1] unit of every other coordinate, while they
/// run for 64 periods (or `duration` seconds when the system is not forced). So starts cover the attractor without a
/// guess about its size; systems of which most states are senseless (negative populations) need starts that are named.
/// 1 for a coordinate that stays at 0.
[[nodiscard]] Eigen::VectorXd typical_range(const models::System& system, const Eigen::VectorXd& theta, double phase,
                                            double duration, std::uint64_t seed, const models::FlowOptions& flow = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
