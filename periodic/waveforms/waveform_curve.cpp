#include "periodic/waveforms/waveform_curve.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::periodic {
namespace {

using Eigen::RowVectorXd;
using Free = std::optional<std::span<const Index>>;

/// The shift of the first point to the plane of an origin, and its derivatives.
struct Shift {
    bool found = false;
    double place = 0.0;
    RowVectorXd by_parameters;
};

Shift shift_to(const PhaseOrigin& origin, const SolvedCurve& curve, const Free& free) {
    constexpr int steps = 30;
    constexpr double rounding = 1e-14;  // of T: where Newton's steps stagnate
    Shift shift;
    double last = 1.0;
    for (int i = 0; i < steps; ++i) {
        const double places[] = {shift.place};
        const CurveStates at = curve.states(places);
        if (!at.simulated) return shift;
        const double slope = origin.normal.dot(at.velocity.col(0));
        const double step = -origin.normal.dot(at.states.col(0) - origin.point) / slope;
        if (!std::isfinite(step)) return shift;
        shift.place += step;
        if (!(std::abs(shift.place) <= 0.25 * curve.length())) return shift;
        const double size = std::abs(step) / curve.length();
        shift.found = size <= rounding || (size < 1e-9 && size >= last);
        if (shift.found) break;
        last = size;
    }
    if (!shift.found || !free) return shift;
    const double places[] = {shift.place};
    const CurveStates at = curve.states(places, free);
    shift.found = at.simulated;
    if (shift.found)
        shift.by_parameters = -(origin.normal.transpose() * at.by_parameters) / origin.normal.dot(at.velocity.col(0));
    return shift;
}

/// d reading / d place along the solution, shape (n, m). The rate of a difference sensor also depends on the phase
/// itself: it is the difference of the angle's rates now and after the delay.
std::optional<MatrixXd> reading_velocity(const models::System& system, const VectorXd& theta,
                                         const models::Sensor& sensor, const CurveStates& at,
                                         std::span<const double> phases, const MatrixXd& derivatives, Index directions,
                                         double rate, const models::FlowOptions& options) {
    const Index n = at.states.rows();
    const Index count = at.states.cols();
    MatrixXd velocity(n, count);
    for (Index k = 0; k < count; ++k)
        velocity.col(k) = derivatives.middleCols(k * directions, n) * at.velocity.col(k);
    if (sensor.type != models::Sensor::Type::angle_difference) return velocity;
    const double delay[] = {sensor.delay};
    MatrixXd later(n, count);
    std::vector<double> later_phases(phases.begin(), phases.end());
    for (Index k = 0; k < count; ++k) {
        auto& phase = later_phases[static_cast<std::size_t>(k)];
        const auto flow = system.flow(at.states.col(k), phase, delay, theta, models::Clock::time, options);
        if (flow.status != models::FlowStatus::ok) return std::nullopt;
        later.col(k) = flow.states.col(0);
        if (system.kind() == models::Kind::forced) phase += rate * sensor.delay;
    }
    const auto read =
        system.readings({}, later, later_phases, theta, std::optional<std::span<const Index>>(std::in_place), options);
    if (read.status != models::FlowStatus::ok) return std::nullopt;
    const MatrixXd f = system.rhs(later, later_phases, theta) / rate;
    const auto angle = static_cast<Index>(sensor.angle);
    for (Index k = 0; k < count; ++k) {
        const double rate_later = read.derivatives.row(angle).segment(k * n, n).dot(f.col(k));
        velocity(static_cast<Index>(sensor.rate), k) = (rate_later - velocity(angle, k)) / sensor.delay;
    }
    return velocity;
}

/// The order in which values ascend.
std::vector<std::size_t> ascending(const std::vector<double>& values) {
    std::vector<std::size_t> order(values.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
    return order;
}

}  // namespace

double SolvedCurve::length() const {
    return system_.kind() == models::Kind::forced ? full_turn * orbit_.period : orbit_.time;
}

double SolvedCurve::place_of_point(Index j) const {
    return system_.kind() == models::Kind::forced ? full_turn * static_cast<double>(j)
                                                  : orbit_.times(j) - orbit_.times(0);
}

CurveStates SolvedCurve::states(std::span<const double> places, std::optional<std::span<const Index>> free) const {
    const bool forced = system_.kind() == models::Kind::forced;
    const Index n = orbit_.points.rows();
    const Index points = orbit_.points.cols();
    const auto count = static_cast<Index>(places.size());
    const Index parameters = free ? static_cast<Index>(free->size()) : 0;
    assert(!free || orbit_.sensitivities.rows() == n * points || parameters == 0);

    std::vector<double> inside(places.size()), turns(places.size());
    for (std::size_t k = 0; k < places.size(); ++k) {
        turns[k] = std::floor(places[k] / length());
        inside[k] = std::clamp(places[k] - turns[k] * length(), 0.0, length());
    }
    const std::vector<std::size_t> order = ascending(inside);

    CurveStates result;
    result.states.resize(n, count);
    result.by_parameters.resize(n, count * parameters);
    const models::Clock clock = forced ? models::Clock::phase : models::Clock::time;
    std::size_t next = 0;
    for (Index j = 0; j < points; ++j) {
        const double begin = place_of_point(j);
        const std::size_t first = next;
        std::vector<double> durations;
        for (; next < order.size() && (j + 1 == points || inside[order[next]] < place_of_point(j + 1)); ++next)
            durations.push_back(std::max(inside[order[next]] - begin, 0.0));
        if (durations.empty()) continue;
        const VectorXd x0 = orbit_.points.col(j);
        const auto flow = free ? system_.flow_with_sensitivities(x0, 0.0, durations, theta_, *free, clock, options_)
                               : system_.flow(x0, 0.0, durations, theta_, clock, options_);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return result;
        for (std::size_t i = 0; i < durations.size(); ++i) {
            const auto k = static_cast<Index>(order[first + i]);
            result.states.col(k) = flow.states.col(static_cast<Index>(i));
            if (parameters == 0) continue;
            const auto x = flow.sensitivity(static_cast<Index>(i), n + parameters);
            result.by_parameters.middleCols(k * parameters, parameters) =
                x.leftCols(n) * orbit_.sensitivities.middleRows(j * n, n) + x.rightCols(parameters);
        }
    }
    std::vector<double> phases(places.size(), 0.0);
    if (forced) phases = inside;
    result.velocity = system_.rhs(result.states, phases, theta_);
    if (forced) result.velocity *= system_.period(theta_, models::Clock::time) / full_turn;
    if (!forced && parameters > 0) {
        // A fixed place is a fixed time; points of the orbit are at fixed fractions of T, and whole turns subtract T.
        for (Index k = 0; k < count; ++k) {
            const auto at = static_cast<std::size_t>(k);
            Index j = 0;
            while (j + 1 < points && !(inside[at] < place_of_point(j + 1)))
                ++j;
            const double shares = turns[at] + place_of_point(j) / length();
            result.by_parameters.middleCols(k * parameters, parameters) -=
                shares * result.velocity.col(k) * orbit_.time_sensitivities;
        }
    }
    result.simulated = result.velocity.allFinite() && result.by_parameters.allFinite();
    return result;
}

CurveReadings readings_along(const models::System& system, const VectorXd& theta, const PeriodicOrbit& orbit,
                             const PhaseOrigin& origin, const models::Sensor& sensor, std::span<const double> times,
                             double phase, Free free, const models::FlowOptions& options) {
    const bool forced = system.kind() == models::Kind::forced;
    const SolvedCurve curve(system, theta, orbit, options);
    const Index parameters = free ? static_cast<Index>(free->size()) : 0;
    CurveReadings result;
    Shift shift;
    double rate = 1.0;
    double per_phase = 1.0;
    RowVectorXd by_frequency = RowVectorXd::Zero(parameters);
    RowVectorXd moved = RowVectorXd::Zero(parameters);
    if (forced) {
        rate = full_turn / system.period(theta, models::Clock::time);
        const auto omega = system.forcing_frequency();
        for (Index i = 0; i < parameters; ++i)
            if (omega && (*free)[static_cast<std::size_t>(i)] == *omega) by_frequency(i) = 1.0;
    } else {
        shift = shift_to(origin, curve, free);
        if (!shift.found) return result;
        per_phase = orbit.time / full_turn;
        if (parameters > 0) moved = shift.by_parameters + phase / full_turn * orbit.time_sensitivities;
    }
    std::vector<double> places(times.size());
    for (std::size_t k = 0; k < times.size(); ++k)
        places[k] = shift.place + phase * per_phase + rate * times[k];
    const CurveStates at = curve.states(places, free);
    if (!at.simulated) return result;
    const auto read = system.readings(sensor, at.states, places, theta, free, options);
    if (read.status != models::FlowStatus::ok || !read.readings.allFinite()) return result;
    result.readings = read.readings;
    result.simulated = true;
    if (!free) return result;

    const Index n = at.states.rows();
    const Index directions = n + parameters;
    const auto velocity =
        reading_velocity(system, theta, sensor, at, places, read.derivatives, directions, rate, options);
    if (!velocity) {
        result.simulated = false;
        return result;
    }
    result.by_phase = per_phase * *velocity;
    result.by_parameters.resize(n, at.states.cols() * parameters);
    for (Index k = 0; k < at.states.cols(); ++k) {
        const auto derivative = read.derivatives.middleCols(k * directions, directions);
        const RowVectorXd place = moved + times[static_cast<std::size_t>(k)] * by_frequency;
        result.by_parameters.middleCols(k * parameters, parameters) =
            derivative.leftCols(n) * at.by_parameters.middleCols(k * parameters, parameters) +
            derivative.rightCols(parameters) + velocity->col(k) * place;
    }
    result.simulated = result.by_phase.allFinite() && result.by_parameters.allFinite();
    return result;
}

}  // namespace orbid::periodic
