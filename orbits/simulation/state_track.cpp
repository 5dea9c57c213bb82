#include "orbits/simulation/state_track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/arithmetic/median.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/simulation/initial_state.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/state_filter.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr models::FlowOptions track_flow{1e-8, 1e-8, 20000};
constexpr Index longest_window = 65;  // samples of the fit of the first state

/// Upper bound of the sd of a reading: fourth differences of a smooth course are small, those of its errors are
/// sqrt(70) of their sd.
double roughness(const Eigen::Ref<const VectorXd>& values) {
    constexpr double normal_median = 1.4826;
    std::vector<double> known, differences;
    for (const double value : values)
        if (std::isfinite(value)) known.push_back(value);
    for (std::size_t k = 4; k < known.size(); ++k)
        differences.push_back(
            std::abs(known[k] - 4.0 * known[k - 1] + 6.0 * known[k - 2] - 4.0 * known[k - 3] + known[k - 4]));
    return normal_median * models::upper_median(std::move(differences)) / std::sqrt(70.0);
}

/// Readings of an angle, running on across the cut of the circle.
void follow_turns(VectorXd& values) {
    double last = std::numeric_limits<double>::quiet_NaN();
    for (double& value : values) {
        if (!std::isfinite(value)) continue;
        if (std::isfinite(last)) value = last + models::wrapped(value - last);
        last = value;
    }
}

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

/// What the flow from a state misses of the readings of the first samples, in units of their sds.
struct WindowMiss {
    VectorXd e;
    MatrixXd slope;  ///< per range of each coordinate
};

class FirstWindow {
public:
    FirstWindow(const FollowedRecord& record, VectorXd sd) : record_(record), sd_(std::move(sd)) {}

    /// Over as many samples as errors grow by a factor e on from x, but more readings than twice the coordinates.
    void choose_length(const VectorXd& x) {
        const Index n = record_.system.dimension();
        const Index most = std::min(longest_window, record_.values.cols());
        const Index least = std::min(most, 2 * n / std::ssize(record_.coordinates) + 2);
        length_ = most;
        for (; length_ > least; length_ = std::max(least, length_ / 2)) {
            const auto flow = from(x);
            if (flow.status != models::FlowStatus::ok || !flow.sensitivities.allFinite()) continue;
            const MatrixXd grown = record_.range.cwiseInverse().asDiagonal() * flow.sensitivities.rightCols(n) *
                                   record_.range.asDiagonal();
            if (models::singular_values(grown)[0] <= std::numbers::e) break;
        }
    }

    /// Empty where it cannot be computed.
    [[nodiscard]] WindowMiss miss(const VectorXd& x) const {
        const Index n = record_.system.dimension(), rows = std::ssize(record_.coordinates);
        const auto flow = from(x);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite() || !flow.sensitivities.allFinite())
            return {};
        const auto read = record_.system.readings(record_.sensor, flow.states,
                                                  std::span(record_.phases).first(static_cast<std::size_t>(length_)),
                                                  record_.theta, std::span<const Index>{}, track_flow);
        if (read.status != models::FlowStatus::ok || !read.readings.allFinite() || !read.derivatives.allFinite())
            return {};
        WindowMiss result{VectorXd::Zero(rows * length_), MatrixXd::Zero(rows * length_, n)};
        for (Index k = 0; k < length_; ++k)
            for (Index i = 0; i < rows; ++i) {
                if (!std::isfinite(record_.values(i, k))) continue;
                const Index row = record_.coordinates[static_cast<std::size_t>(i)];
                double e = record_.values(i, k) - read.readings(row, k);
                if (models::reads_angle(record_.sensor, record_.system.coordinates(), static_cast<std::size_t>(row)))
                    e = models::wrapped(e);
                result.e[k * rows + i] = e / sd_[i];
                result.slope.row(k * rows + i) = read.derivatives.row(row).segment(k * n, n) *
                                                 flow.sensitivities.middleCols(k * n, n) * record_.range.asDiagonal() /
                                                 sd_[i];
            }
        return result;
    }

    /// Levenberg and Marquardt. @return the sum of squares; infinite where none can be computed
    double improve(VectorXd& x) const {
        constexpr int steps = 30;
        constexpr double least_step = 1e-6, too_damped = 1e6;
        WindowMiss now = miss(x);
        if (now.e.size() == 0) return std::numeric_limits<double>::infinity();
        double sum = now.e.squaredNorm(), damping = 1e-3;
        const Index n = x.size();
        for (int step = 0; step < steps && damping < too_damped; ++step) {
            const double size = std::sqrt(now.slope.squaredNorm() / static_cast<double>(n));
            MatrixXd stacked(now.e.size() + n, n);
            stacked << now.slope, std::sqrt(damping) * size * MatrixXd::Identity(n, n);
            VectorXd right = VectorXd::Zero(stacked.rows());
            right.head(now.e.size()) = now.e;
            const VectorXd change = models::PivotedFactor(stacked).solve(right);
            const VectorXd next = x + record_.range.cwiseProduct(change);
            WindowMiss trial = change.allFinite() ? miss(next) : WindowMiss{};
            if (trial.e.size() == 0 || !(trial.e.squaredNorm() <= sum)) {
                damping *= 10.0;
                continue;
            }
            x = next;
            now = std::move(trial);
            sum = now.e.squaredNorm();
            damping = std::max(damping / 10.0, 1e-9);
            if (change.norm() <= least_step) break;
        }
        return sum;
    }

private:
    [[nodiscard]] models::FlowResult from(const VectorXd& x) const {
        std::vector<double> durations;
        for (Index k = 0; k < length_; ++k)
            durations.push_back(record_.at[k] - record_.at[0]);
        return record_.system.flow_with_sensitivities(x, record_.phases.front(), durations, record_.theta, {},
                                                      record_.clock, track_flow);
    }

    const FollowedRecord& record_;
    VectorXd sd_;
    Index length_ = 1;
};

/// The state that the first readings tell by themselves, and others on the flow from it: shape (n, candidates).
MatrixXd candidates(const FollowedRecord& record, const Segment& data, const VectorXd& first) {
    constexpr Index others = 32;
    const Index length = std::min(longest_window, record.values.cols());
    const VectorXd times = data.times.size() > 0 ? VectorXd(data.times.head(length)) : VectorXd(record.at.head(length));
    const Segment beginning{data.label, record.values.leftCols(length), times, {}};
    VectorXd guess = initial_state(record.system, record.theta,
                                   {beginning, record.coordinates, record.sensor, record.phases.front()});
    const auto set_known = [&](auto&& x) {
        for (Index i = 0; i < first.size(); ++i)
            if (std::isfinite(first[i])) x[i] = first[i];
    };
    if (!guess.allFinite()) guess = VectorXd::Zero(guess.size());
    set_known(guess);
    if (first.size() > 0 && first.allFinite()) return guess;
    std::vector<double> durations;
    const double whole = record.at[record.at.size() - 1] - record.at[0];
    for (Index j = 1; j <= others; ++j)
        durations.push_back(whole * static_cast<double>(j) / static_cast<double>(others));
    const auto flow =
        record.system.flow(guess, record.phases.front(), durations, record.theta, record.clock, track_flow);
    if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return guess;
    MatrixXd all(guess.size(), others + 1);
    all << guess, flow.states;
    for (Index j = 0; j < all.cols(); ++j)
        set_known(all.col(j));
    return all;
}

/// Refuses a record of which a direction of the first state cannot be told.
void check_determined(const FollowedRecord& record, const Segment& data, const MatrixXd& states, const VectorXd& sd) {
    constexpr double enough_growth = 1e4;
    constexpr double least_information = 1e-6;  // per squared range: an sd of a thousand ranges
    const Index n = record.system.dimension();
    MatrixXd carried = MatrixXd::Identity(n, n);
    MatrixXd information = MatrixXd::Zero(n, n);
    for (Index k = 0; k < states.cols() && carried.norm() < enough_growth; ++k) {
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
        if (k + 1 == states.cols()) break;
        const std::array<double, 1> duration{record.at[k + 1] - record.at[k]};
        const auto flow =
            record.system.flow_with_sensitivities(states.col(k), record.phases[static_cast<std::size_t>(k)], duration,
                                                  record.theta, {}, record.clock, track_flow);
        if (flow.status != models::FlowStatus::ok || !flow.sensitivities.allFinite()) break;
        carried = record.range.cwiseInverse().asDiagonal() * flow.sensitivities * record.range.asDiagonal() * carried;
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
                        const models::Sensor& sensor, const VectorXd& first, std::span<const Index> free) {
    const Segment& data = series.segments[segment];
    FollowedRecord record = followed_record(system, theta, series, data, sensor);
    const MatrixXd starts = candidates(record, data, first);
    record.range = state_range(system, starts);
    const VectorXd scale = series.scale();
    VectorXd sd(std::ssize(record.coordinates));
    constexpr double finest = 1e-6;  // of a reading's range
    for (Index i = 0; i < sd.size(); ++i) {
        const double size = scale[record.rows[static_cast<std::size_t>(i)]];
        VectorXd values = record.values.row(i).transpose();
        if (models::reads_angle(record.sensor, system.coordinates(),
                                static_cast<std::size_t>(record.coordinates[static_cast<std::size_t>(i)])))
            follow_turns(values);
        sd[i] = std::max(roughness(values), finest * size);
    }
    FirstWindow window(record, sd);
    window.choose_length(starts.col(0));
    VectorXd best = starts.col(0);
    double least = std::numeric_limits<double>::infinity();
    for (Index j = 0; j < starts.cols(); ++j) {
        VectorXd x = starts.col(j);
        const double sum = window.improve(x);
        if (!(sum < least)) continue;
        least = sum;
        best = x;
    }
    constexpr double guessed = 0.2;  // sd of a guess of a parameter
    for (const Index parameter : free)
        if (theta[parameter] != 0.0 && parameter != system.forcing_frequency()) record.free.push_back(parameter);
    record.free_sd = guessed * theta(record.free).cwiseAbs();
    FilteredStates found = followed_states(record, best, sd);
    record.range = state_range(system, found.states);
    check_determined(record, data, found.states, sd);
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
