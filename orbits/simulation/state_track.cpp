#include "orbits/simulation/state_track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "models/arithmetic/singular_values.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/reading_noise.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/simulation/first_state.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/state_filter.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr models::FlowOptions track_flow{1e-8, 1e-8, 20000};

FollowedRecord followed_record(const models::System& system, const VectorXd& theta, const Series& series,
                               const Segment& data, const models::Sensor& sensor) {
    const Index samples = data.values.cols();
    FollowedRecord record{system, theta, sensor, transition_clock(system, series), {}, VectorXd(samples), {}, {}, {},
                          {},     {},    {}};
    // A difference of readings says of the state what the rate itself says, to first order in the delay.
    if (sensor.type == models::Sensor::Type::angle_difference) record.sensor.type = models::Sensor::Type::state;
    const double step = record.clock == models::Clock::phase ? system.period(theta, record.clock) : 1.0;
    for (Index k = 0; k < samples; ++k) {
        const bool timed = data.times.size() > 0 && record.clock == models::Clock::time;
        record.at[k] = timed ? data.times[k] : step * static_cast<double>(k);
        record.phases.push_back(phase_at(system, theta, series, data, k));
    }
    for (Index row = 0; row < series.dimension(); ++row) {
        const Index index = system.coordinate_index(series.coordinate(row).name);
        if (index < 0) continue;
        record.coordinates.push_back(index);
        record.rows.push_back(row);
    }
    record.values = data.values(record.rows, Eigen::all);
    return record;
}

/// Sds of the readings, as far as the record tells them without a model.
VectorXd reading_sds(const FollowedRecord& record, const Series& series) {
    constexpr double finest = 1e-6;  // of a reading's range
    const VectorXd scale = series.scale();
    VectorXd sd(std::ssize(record.coordinates));
    for (Index i = 0; i < sd.size(); ++i) {
        const auto row = static_cast<std::size_t>(i);
        const bool angle = models::reads_angle(record.sensor, record.system.coordinates(),
                                               static_cast<std::size_t>(record.coordinates[row]));
        sd[i] = std::max(reading_noise(record.values.row(i).transpose(), angle), finest * scale[record.rows[row]]);
    }
    return sd;
}

constexpr double least_information = 1e-6;  // per squared range: an sd of a thousand ranges

/// Information of all readings on the first state of a course, per squared range, until errors have grown too far.
MatrixXd first_information(const FollowedRecord& record, const MatrixXd& states, const VectorXd& sd) {
    constexpr double enough_growth = 1e4;
    const Index n = record.system.dimension();
    MatrixXd carried = MatrixXd::Identity(n, n);
    MatrixXd information = MatrixXd::Zero(n, n);
    const Index samples = std::min(states.cols(), record.values.cols());
    for (Index k = 0; k < samples && carried.norm() < enough_growth; ++k) {
        const std::array<double, 1> phase{record.phases[static_cast<std::size_t>(k)]};
        const auto read = record.system.readings(record.sensor, states.col(k), phase, record.theta,
                                                 std::span<const Index>{}, track_flow);
        for (std::size_t i = 0; i < record.coordinates.size(); ++i) {
            if (read.status != models::FlowStatus::ok || !std::isfinite(record.values(static_cast<Index>(i), k)))
                continue;
            const Eigen::RowVectorXd row = read.derivatives.row(record.coordinates[i]) * record.range.asDiagonal() *
                                           carried / sd[static_cast<Index>(i)];
            if (row.allFinite()) information += row.transpose() * row;
        }
        if (k + 1 == samples) break;
        const std::array<double, 1> duration{record.at[k + 1] - record.at[k]};
        const auto flow =
            record.system.flow_with_sensitivities(states.col(k), record.phases[static_cast<std::size_t>(k)], duration,
                                                  record.theta, {}, record.clock, track_flow);
        if (flow.status != models::FlowStatus::ok || !flow.sensitivities.allFinite()) break;
        carried = record.range.cwiseInverse().asDiagonal() * flow.sensitivities * record.range.asDiagonal() * carried;
    }
    return information;
}

/// Refuses a record of which a direction of the first state cannot be told, neither on the course found nor on those of
/// the model: a course on which no error of a coordinate is seen (y = z = 0, say) may be a bad guess.
void check_determined(const FollowedRecord& record, const Segment& data, const MatrixXd& states,
                      const MatrixXd& courses, const VectorXd& sd) {
    const Index n = record.system.dimension();
    MatrixXd information = first_information(record, states, sd);
    if (models::singular_values(information)[n - 1] > least_information) return;
    constexpr Index looks = 8, longest = 200;
    std::vector<double> durations;
    for (Index k = 0; k < std::min(longest, record.at.size()); ++k)
        durations.push_back(record.at[k] - record.at[0]);
    for (Index k = 0; k < looks; ++k) {
        const auto flow = record.system.flow(courses.col(k * courses.cols() / looks), record.phases.front(), durations,
                                             record.theta, record.clock, track_flow);
        if (flow.status == models::FlowStatus::ok) information += first_information(record, flow.states, sd);
    }
    const auto directions = models::singular_value_decomposition(information, models::SingularVectors::right);
    refuse_record_if(!(directions.values[0] > least_information),
                     "segment {}: its readings say nothing of the state: no formula changes with a coordinate",
                     data.label);
    if (directions.values[n - 1] > least_information) return;
    Index unknown = 0;
    directions.v.col(n - 1).cwiseAbs().maxCoeff(&unknown);
    refuse_record_if(true,
                     "segment {}: its readings say nothing of {}, now or later: use whole segments with an "
                     "initial state that is held",
                     data.label, record.system.coordinates()[static_cast<std::size_t>(unknown)].name);
}

}  // namespace

bool needs_tracking(const models::System& system, const Series& series, const models::Sensor& sensor) {
    if (sensor.type == models::Sensor::Type::function) return true;
    Index read = 0;
    for (Index row = 0; row < series.dimension(); ++row)
        read += system.coordinate_index(series.coordinate(row).name) >= 0 ? 1 : 0;
    return system.dimension() - read > read && series.sampling == Series::Sampling::samples;
}

StateTrack track_states(const models::System& system, const VectorXd& theta, const Series& series, std::size_t segment,
                        const models::Sensor& sensor, const VectorXd& first, std::span<const Index> free,
                        std::uint64_t* work) {
    const Segment& data = series.segments[segment];
    FollowedRecord record = followed_record(system, theta, series, data, sensor);
    const VectorXd sd = reading_sds(record, series);
    const FirstStates begin = first_states(record, data, first, sd);
    if (work != nullptr) *work += begin.work;
    record.range = state_range(system, begin.courses);
    constexpr double guessed = 0.2;  // sd of a guess of a parameter
    for (const Index parameter : free)
        if (theta[parameter] != 0.0 && parameter != system.forcing_frequency()) record.free.push_back(parameter);
    record.free_sd = guessed * theta(record.free).cwiseAbs();
    FilteredStates found = followed_states(record, begin.states, sd);
    if (work != nullptr) *work += found.work;
    refuse_record_if(found.states.size() == 0,
                     "segment {}: the model cannot follow its readings from the starts of its parameters: begin with "
                     "others, or say an initial state",
                     data.label);
    record.range = state_range(system, found.states);
    check_determined(record, data, found.states, begin.courses, sd);
    StateTrack track{std::move(found.states), std::move(found.theta),
                     VectorXd::Constant(series.dimension(), std::numeric_limits<double>::quiet_NaN())};
    for (Index i = 0; i < sd.size(); ++i)
        track.reading_sd[record.rows[static_cast<std::size_t>(i)]] = found.surprise[i];
    return track;
}

std::vector<MatrixXd> followed_series(std::span<const std::shared_ptr<const models::System>> systems,
                                      const VectorXd& theta, const Series& series, const models::Sensor& sensor,
                                      const std::vector<std::size_t>& segments) {
    if (!needs_tracking(*systems.front(), series, sensor)) return {};
    std::vector<MatrixXd> known(series.segments.size());
    for (const std::size_t s : segments)
        known[s] = track_states(*systems[systems.size() == 1 ? 0 : s], theta, series, s, sensor).states;
    return known;
}

}  // namespace orbid::orbits
