#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
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

/// A record of states at a phase of the forcing, of iterates of a map, or of an autonomous flow's crossings of a plane.
struct SectionPlan {
    std::size_t sections = 0;     ///< in all, > 0; spread over the trajectories as evenly as possible
    std::size_t transient = 300;  ///< sections left out at every start and restart; the start itself is the first,
                                  ///< but no crossing of a plane
    /// For autonomous flows only. The record keeps the times of the crossings since the start or restart.
    std::optional<models::Section> section = {};
    /// [s], > 0: a trajectory without a crossing for this long is at rest or cannot be continued. 0: 100 times the
    /// median return of a few trajectories, see probe_returns().
    double longest_return = 0.0;
};

/// Record of samples in time.
struct SamplePlan {
    double step = 0.0;          ///< [s], > 0
    std::size_t count = 0;      ///< samples of each trajectory, > 0
    std::size_t transient = 0;  ///< sampling intervals left out at the start; times count from the start
};

/// Whether a trajectory is restarted that reaches a stable periodic orbit, comes to rest or cannot be continued, since
/// it yields no further information. Sections only; trajectories of samples are never restarted.
enum class Restart { when_captured_or_at_rest, never };

struct VirtualExperimentOptions {
    std::variant<SectionPlan, SamplePlan> plan;
    std::size_t trajectories = 1;  ///< > 0; one segment each, and one more for every restart
    /// Shape (n, trajectories): one start per trajectory. Empty (0 columns): random starts, angles uniform on the
    /// circle, other coordinates uniform in +- random_range.
    Eigen::MatrixXd initial;
    /// Shape (n), > 0 except for angles. Empty: typical_range(), or the range that 16 trajectories from random starts
    /// within one unit reach in 64 returns to a plane.
    Eigen::VectorXd random_range;
    Restart restart = Restart::when_captured_or_at_rest;
    /// [rad] of the section; samples: of the forcing at time 0. With measured inputs: time [s] of the start on the
    /// clock of their signal.
    double phase = 0.0;
    models::Sensor sensor;  ///< what is recorded of a state
    /// Shape (n): sd of the normal error of a reading, >= 0, in the coordinate's unit. Empty: none. With an
    /// angle_difference sensor the error of an angle reading enters the angle once and the difference twice. The rate
    /// has no error of its own (its entry must be 0).
    Eigen::VectorXd noise;
    /// Shape (n), in (-1, 1): correlation of successive errors in a segment, a stationary first-order autoregression
    /// with the sd of `noise`. Empty: independent. 0 for an angle_difference sensor.
    Eigen::VectorXd noise_correlation;
    std::uint64_t seed = 0;
    models::FlowOptions flow;
    std::function<bool()> interrupted{};  ///< asked while states are read; System::with_stop() asks while they flow
};

/// An interruption of a trajectory, or a restart.
struct TrajectoryEvent {
    enum class Kind { captured, at_rest, failed, restarted };
    Kind kind = Kind::captured;
    std::size_t trajectory = 0;
    std::size_t section = 0;  ///< sections (samples) since the trajectory's first start, transients included
    int period = 0;           ///< captured: sections until the orbit repeats
    models::FlowStatus status = models::FlowStatus::ok;  ///< failed: why; at_rest: no_crossing if that ended it
    Eigen::VectorXd state;  ///< shape (n): a point of the orbit, the place of rest, the last state; the new start
};
[[nodiscard]] std::string_view name(TrajectoryEvent::Kind kind);

struct VirtualExperiment {
    Series series;  ///< coordinates as the system names them; formulas of the sensor are not angles
    std::vector<TrajectoryEvent> events;  ///< by trajectory, then by section
    bool complete = true;                 ///< every trajectory delivered all its points
    std::string message;                  ///< why not, when it is not complete
};

/// Simulates a record of a system as an experiment would take it: trajectories after a transient, read by a sensor with
/// normal errors, the angle then rounded to the sensor's step (Sensor::rounding).
///
/// A trajectory of sections counts as captured by a stable orbit of period p <= 64 when its last 256 sections repeat
/// after p within 1e-9 of each coordinate's range. (Rounding, 1e-16, drives a trajectory off an unstable orbit in that
/// time unless its largest multiplier is below 1.065 per section.) It is restarted from a new random state with a new
/// transient, in a new segment; the record after it had settled is cut off. A trajectory lost 20 times before it
/// delivers one point is given up (complete = false). With Restart::never everything is kept and the event is only
/// reported; a trajectory that cannot be continued ends early. A flow that no longer meets its plane is at rest if it
/// has settled on an equilibrium by the longest return time (event at_rest with status no_crossing). Otherwise it has
/// failed.
///
/// Random numbers come from counter-based streams keyed by (seed, purpose, index): the same bytes for any number of
/// threads. Parallel over trajectories; noise is parallel over segments.
///
/// @param theta  shape (q), all parameters of the system.
/// @throws std::invalid_argument naming value and rule: wrong shapes, nothing to record, an autonomous flow without a
///         plane or another system with one, a plane for measured inputs (they tell the time), negative noise, noise on
///         a rate that is a difference of readings, starts that are not finite.
[[nodiscard]] VirtualExperiment simulate(const models::System& system, const Eigen::VectorXd& theta,
                                         const VirtualExperimentOptions& options);

/// Half the range of random starts, shape (n): pi for angles, otherwise the largest absolute value that 16 trajectories
/// reach. These start at random on the circle of every angle and in +- System::state_size() of every other coordinate.
/// They run for 64 periods, or `duration` seconds when the system is not forced. Starts then cover the attractor
/// without a guess of its size. Systems in which most states are meaningless (negative populations) need explicit
/// starts. 1 for a coordinate that stays at 0.
[[nodiscard]] Eigen::VectorXd typical_range(const models::System& system, const Eigen::VectorXd& theta, double phase,
                                            double duration, std::uint64_t seed, const models::FlowOptions& flow = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
