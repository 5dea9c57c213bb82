#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// A measured state (the sensor inverted) and the measured state that follows.
struct Transition {
    Eigen::VectorXd from;   ///< shape (n)
    Eigen::VectorXd to;     ///< shape (n)
    double phase = 0.0;     ///< [rad] at `from`
    double duration = 0.0;  ///< of the clock of the flow: [rad] between sections, [s] between samples, iterations
    std::size_t segment = 0;
};

/// The clock of transitions of a series: phase for sections of forced models, time otherwise.
[[nodiscard]] models::Clock transition_clock(const models::System& system, const Series& series);

/// At most `count` transitions of a series over one interval, spread over the whole record (`seed`: where exactly);
/// states from the readings by inverting the sensor at theta, unread coordinates from slopes. Missing readings give no
/// transition.
/// @param theta     shape (q), all parameters of the system.
/// @param interval  sampling intervals per transition, > 0.
[[nodiscard]] std::vector<Transition> transitions(const models::System& system, const Eigen::VectorXd& theta,
                                                  const Series& series, const models::Sensor& sensor,
                                                  const std::vector<std::size_t>& segments, Eigen::Index interval,
                                                  std::size_t count, std::uint64_t seed);

/// The same with one system per segment of the series, each with its measured inputs, or one in all.
/// @param known  states at all samples of every segment (track_states()), shape (n, samples); none: from the readings.
[[nodiscard]] std::vector<Transition> transitions(std::span<const std::shared_ptr<const models::System>> systems,
                                                  const Eigen::VectorXd& theta, const Series& series,
                                                  const models::Sensor& sensor,
                                                  const std::vector<std::size_t>& segments, Eigen::Index interval,
                                                  std::size_t count, std::uint64_t seed,
                                                  std::span<const Eigen::MatrixXd> known = {});

/// What a flow among others has cost, in steps. One that does not come to its end is computed twice: in a pack, and
/// then alone.
[[nodiscard]] inline std::uint64_t flow_cost(const models::FlowResult& flow) {
    return flow.status == models::FlowStatus::ok ? flow.steps : 2 * flow.steps;
}

/// Work: what steps of the integrator with derivatives in so many directions cost, in steps without derivatives of
/// short equations, see models::System::evaluation_cost(). The same on every machine.
[[nodiscard]] std::uint64_t flow_work(const models::System& system, std::uint64_t steps, Eigen::Index directions);

/// The error of a predicted transition: to - Phi(from), angles wrapped, and derivatives of Phi.
struct Prediction {
    bool ok = false;
    Eigen::VectorXd error;    ///< shape (n)
    Eigen::MatrixXd by_x;     ///< X of (M4), shape (n, n); empty without derivatives
    Eigen::MatrixXd by_free;  ///< Y of (M4), shape (n, f)
    std::uint64_t cost = 0;   ///< see flow_cost()
};

/// Predictions of all transitions. With measured inputs `systems` has one system per segment of the series, otherwise
/// one in all. Parallel, with the same bytes for any number of threads.
/// @param delay  parameter that is the delay of the inputs: flows begin so much earlier on their clock than the phases
///               of the transitions say, and derivatives with respect to it are complete.
[[nodiscard]] std::vector<Prediction> predictions(std::span<const std::shared_ptr<const models::System>> systems,
                                                  const Eigen::VectorXd& theta,
                                                  const std::vector<Transition>& transitions,
                                                  std::optional<std::span<const Eigen::Index>> free,
                                                  models::Clock clock, const models::FlowOptions& flow,
                                                  std::optional<Eigen::Index> delay = std::nullopt);

/// Sizes of the errors of states from readings, relative to each other, shape (n): the ranges; of a difference quotient
/// sqrt 2 / delay times that of its angle.
[[nodiscard]] Eigen::VectorXd error_sizes(const models::Sensor& sensor, const Eigen::VectorXd& range);

/// Errors of states estimated from the errors of predictions, per coordinate in units of `sizes`: 1.4826 times the
/// median of
///     |e_i| / (d_i sqrt(1 + sum_j (X_ij d_j / d_i)^2)),  d = sizes,
/// an upper bound while parameters are wrong. 0 without predictions.
[[nodiscard]] Eigen::VectorXd prediction_noise(const std::vector<Prediction>& predictions,
                                               const Eigen::VectorXd& sizes);

/// Size of each coordinate's range, shape (n): Series::scale() where it is read, what the given states (shape (n, m))
/// span otherwise; 1 where that is 0.
[[nodiscard]] Eigen::VectorXd coordinate_range(const models::System& system, const Series& series,
                                               const Eigen::MatrixXd& states);

/// The same of what states span alone: where readings are no states.
[[nodiscard]] Eigen::VectorXd state_range(const models::System& system, const Eigen::MatrixXd& states);

/// Sampling intervals from node to node such that errors of a node grow by no more than a factor e^2 (the spectral norm
/// of X, coordinates in units of their ranges), of hidden coordinates e, and predictions from the states that the data
/// say stay within a fifth of the range; both in nine of ten places of the record and at the given parameters. 1 for
/// sections.
///
/// Longer intervals need fewer nodes, but bend: exp(growth) is what a Newton step has to linearise. Of 53 chaotic
/// systems e^2 solved as many as e where all coordinates were read, and lost one where the first alone was.
///
/// @param systems  one per segment of the series, each with its measured inputs, or one in all.
/// @param theta    shape (q), all parameters of the system.
/// @param known    as in transitions().
[[nodiscard]] Eigen::Index shooting_interval(std::span<const std::shared_ptr<const models::System>> systems,
                                             const Eigen::VectorXd& theta, const Series& series,
                                             const models::Sensor& sensor, const std::vector<std::size_t>& segments,
                                             std::span<const Eigen::MatrixXd> known = {});

}  // namespace orbid::orbits
