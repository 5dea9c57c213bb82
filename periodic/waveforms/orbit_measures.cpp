#include "periodic/waveforms/orbit_measures.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/waveforms/waveform_curve.hpp"

namespace orbid::periodic {
namespace {

using Eigen::RowVectorXd;

constexpr Index fewest = 64, most = 512;
/// A Fourier series ends where the upper quarter of its terms is below this share of the largest.
constexpr double negligible = 1e-10;
/// A formula is the same after a turn where it differs by less than this share of its size: 2 pi is rounded.
constexpr double same_reading = 1e-9;

/// Coefficients c_j = (1/m) sum_k x_k exp(-2 pi i j k / m), j = 0, ..., m / 2.
std::vector<std::complex<double>> fourier_series(const VectorXd& x) {
    const Index m = x.size();
    std::vector<std::complex<double>> unit(static_cast<std::size_t>(m));
    for (Index k = 0; k < m; ++k)
        unit[static_cast<std::size_t>(k)] =
            std::polar(1.0, -full_turn * static_cast<double>(k) / static_cast<double>(m));
    std::vector<std::complex<double>> series(static_cast<std::size_t>(m / 2 + 1));
    for (std::size_t j = 0; j < series.size(); ++j) {
        for (Index k = 0; k < m; ++k)
            series[j] += x(k) * unit[(j * static_cast<std::size_t>(k)) % static_cast<std::size_t>(m)];
        series[j] /= static_cast<double>(m);
    }
    return series;
}

/// First and second derivative of the series by the share s of the orbit.
std::pair<double, double> slope_and_curvature(const std::vector<std::complex<double>>& series, double s) {
    std::complex<double> first = 0.0, second = 0.0;
    // The term of half the readings is a cosine that has no slope of its own at them: it is left out.
    for (std::size_t j = 1; j + 1 < series.size(); ++j) {
        const std::complex<double> factor(0.0, full_turn * static_cast<double>(j));
        const std::complex<double> term = 2.0 * series[j] * std::exp(factor * s);
        first += factor * term;
        second += factor * factor * term;
    }
    return {first.real(), second.real()};
}

/// The weights of m equidistant readings in their Fourier series at the share s.
VectorXd weights_at(double s, Index m) {
    VectorXd weights(m);
    for (Index k = 0; k < m; ++k) {
        const double u = std::numbers::pi * (s - static_cast<double>(k) / static_cast<double>(m));
        const double tangent = std::tan(u);
        weights(k) = std::abs(std::sin(u)) < 1e-14
                         ? 1.0
                         : std::sin(static_cast<double>(m) * u) / (static_cast<double>(m) * tangent);
    }
    return weights;
}

/// Angles along an orbit without their jumps. @return the whole turns from its beginning to its end
double make_continuous(Eigen::Ref<RowVectorXd, 0, Eigen::InnerStride<>> angles) {
    for (Index k = 1; k < angles.size(); ++k)
        angles(k) -= full_turn * std::round((angles(k) - angles(k - 1)) / full_turn);
    return std::round((angles(angles.size() - 1) - angles(0)) / full_turn);
}

/// Derivatives of equidistant states of an orbit at fixed shares of it, shape (n, m f): a place is a time, which moves
/// with T.
MatrixXd at_equal_shares(const CurveStates& at, const PeriodicOrbit& orbit, Index f) {
    if (f == 0) return MatrixXd(at.states.rows(), 0);
    MatrixXd all = at.by_parameters;
    const Index count = at.states.cols();
    for (Index k = 0; orbit.time_sensitivities.size() > 0 && k < count; ++k)
        all.middleCols(k * f, f) +=
            (static_cast<double>(k) / static_cast<double>(count)) * at.velocity.col(k) * orbit.time_sensitivities;
    return all;
}

/// The formulas as sensors that read them in the place of coordinates, as many as a model has at a time.
std::vector<models::Sensor> sensors_of(std::span<const OrbitReading> formulas, std::size_t coordinates) {
    std::vector<models::Sensor> sensors;
    for (std::size_t i = 0; i < formulas.size(); ++i) {
        if (i % coordinates == 0) sensors.emplace_back().type = models::Sensor::Type::function;
        sensors.back().functions.push_back({i % coordinates, formulas[i].formula});
    }
    return sensors;
}

}  // namespace

OrbitReadings::OrbitReadings(const models::System& system, const VectorXd& theta, const PeriodicOrbit& orbit,
                             const models::Sensor& sensor, std::optional<std::span<const Index>> free,
                             const models::FlowOptions& options, std::span<const OrbitReading> formulas) {
    std::vector<models::Sensor> sensors = sensors_of(formulas, static_cast<std::size_t>(system.dimension()));
    sensors.insert(sensors.begin(), sensor);
    Index count = fewest;
    for (;; count *= 2) {
        simulated_ = read(system, theta, orbit, sensors, std::nullopt, count, options);
        if (!simulated_ || count == most || resolved()) break;
    }
    // Derivatives cost many times more than readings.
    if (simulated_ && free) simulated_ = read(system, theta, orbit, sensors, free, count, options);
    const auto f = free ? std::ssize(*free) : Index{0};
    frequency_.by_parameters = RowVectorXd::Zero(f);
    if (system.kind() == models::Kind::forced) {
        frequency_.value = 1.0 / (orbit.period * system.period(theta, models::Clock::time));
        const auto omega = system.forcing_frequency();
        for (Index i = 0; i < f; ++i)
            if (omega && (*free)[static_cast<std::size_t>(i)] == *omega)
                frequency_.by_parameters(i) = 1.0 / (full_turn * orbit.period);
    } else {
        frequency_.value = 1.0 / orbit.time;
        if (f > 0) frequency_.by_parameters = -orbit.time_sensitivities / (orbit.time * orbit.time);
    }
}

bool OrbitReadings::read(const models::System& system, const VectorXd& theta, const PeriodicOrbit& orbit,
                         const std::vector<models::Sensor>& sensors, std::optional<std::span<const Index>> free,
                         Index count, const models::FlowOptions& options) {
    const SolvedCurve curve(system, theta, orbit, options);
    std::vector<double> places(static_cast<std::size_t>(count));
    for (std::size_t k = 0; k < places.size(); ++k)
        places[k] = curve.length() * static_cast<double>(k) / static_cast<double>(count);
    const CurveStates at = curve.states(places, free);
    if (!at.simulated) return false;
    const Index n = system.dimension();
    const auto f = free ? std::ssize(*free) : Index{0};
    const MatrixXd states_by_parameters = at_equal_shares(at, orbit, f);
    Index rows = n;
    for (std::size_t i = 1; i < sensors.size(); ++i)
        rows += std::ssize(sensors[i].functions);
    readings_.resize(rows, count);
    by_parameters_.resize(rows, count * f);
    turning_.assign(static_cast<std::size_t>(rows), false);
    const auto take = [&](const models::Sensor& sensor, const MatrixXd& states, Index first, Index own) {
        const auto read = system.readings(sensor, states, places, theta, free, options);
        if (read.status != models::FlowStatus::ok || !read.readings.topRows(own).allFinite()) return false;
        readings_.middleRows(first, own) = read.readings.topRows(own);
        for (Index k = 0; f > 0 && k < count; ++k) {
            const auto derivative = read.derivatives.middleCols(k * (n + f), n + f).topRows(own);
            by_parameters_.block(first, k * f, own, f) =
                derivative.leftCols(n) * states_by_parameters.middleCols(k * f, f) + derivative.rightCols(f);
        }
        return true;
    };
    if (!take(sensors.front(), at.states, 0, n)) return false;
    for (Index i = 0; i < n; ++i) {
        if (!models::reads_angle(sensors.front(), system.coordinates(), static_cast<std::size_t>(i))) continue;
        turning_[static_cast<std::size_t>(i)] = make_continuous(readings_.row(i)) != 0.0;
        readings_.row(i).array() -= full_turn * std::round(readings_.row(i).mean() / full_turn);
    }
    if (sensors.size() == 1) return by_parameters_.allFinite();
    MatrixXd states = at.states;
    VectorXd turn_later = states.col(0);
    for (Index i = 0; i < n; ++i)
        if (system.coordinates()[static_cast<std::size_t>(i)].angle)
            turn_later(i) += full_turn * make_continuous(states.row(i));
    Index first = n;
    for (auto sensor = sensors.begin() + 1; sensor != sensors.end(); ++sensor) {
        const Index own = std::ssize(sensor->functions);
        if (!take(*sensor, states, first, own)) return false;
        const auto later = system.readings(*sensor, turn_later, {places.data(), 1}, theta, std::nullopt, options);
        for (Index i = first; i < first + own; ++i) {
            const double moved = std::abs(later.readings(i - first, 0) - readings_(i, 0));
            turning_[static_cast<std::size_t>(i)] = !(moved <= same_reading * readings_.row(i).cwiseAbs().maxCoeff());
        }
        first += own;
    }
    return by_parameters_.allFinite();
}

bool OrbitReadings::resolved() const {
    for (Index i = 0; i < readings_.rows(); ++i) {
        const auto series = fourier_series(readings_.row(i));
        double largest = 0.0, last = 0.0;
        for (std::size_t j = 1; j < series.size(); ++j) {
            largest = std::max(largest, std::abs(series[j]));
            if (4 * j >= 3 * series.size()) last = std::max(last, std::abs(series[j]));
        }
        if (last > negligible * largest) return false;
    }
    return true;
}

MeasuredValue OrbitReadings::weighted(Index coordinate, const VectorXd& weights) const {
    const Index m = readings_.cols();
    const Index f = by_parameters_.cols() / m;
    MeasuredValue result{readings_.row(coordinate).dot(weights), RowVectorXd::Zero(f)};
    for (Index k = 0; k < m; ++k)
        result.by_parameters += weights(k) * by_parameters_.row(coordinate).segment(k * f, f);
    return result;
}

MeasuredValue OrbitReadings::extremum(Index coordinate, double sign) const {
    const VectorXd x = sign * readings_.row(coordinate).transpose();
    const auto series = fourier_series(x);
    const Index m = x.size();
    const double interval = 1.0 / static_cast<double>(m);
    Index highest = 0;
    x.maxCoeff(&highest);
    const double from = static_cast<double>(highest) * interval;
    double s = from;
    for (int i = 0; i < 30; ++i) {
        const auto [slope, curvature] = slope_and_curvature(series, s);
        const double step = curvature < 0.0 ? -slope / curvature : 0.0;
        s = std::clamp(s + step, from - interval, from + interval);
        if (std::abs(step) < 1e-14) break;
    }
    MeasuredValue best = weighted(coordinate, weights_at(s, m));
    // At a kink the series may overshoot or miss.
    if (!(sign * best.value >= x(highest))) best = weighted(coordinate, VectorXd::Unit(m, highest));
    return best;
}

std::optional<MeasuredValue> OrbitReadings::measure(OrbitMeasure measure, Index coordinate) const {
    if (measure == OrbitMeasure::frequency) return frequency_;
    if (turning_[static_cast<std::size_t>(coordinate)]) return std::nullopt;
    const Index m = readings_.cols();
    const auto equal = VectorXd::Constant(m, 1.0 / static_cast<double>(m));
    switch (measure) {
        case OrbitMeasure::maximum:
            return extremum(coordinate, 1.0);
        case OrbitMeasure::minimum:
            return extremum(coordinate, -1.0);
        case OrbitMeasure::mean:
            return weighted(coordinate, equal);
        case OrbitMeasure::rms: {
            const VectorXd x = readings_.row(coordinate);
            const double rms = std::sqrt(x.squaredNorm() / static_cast<double>(m));
            MeasuredValue result = weighted(coordinate, x / (static_cast<double>(m) * std::max(rms, 1e-300)));
            result.value = rms;
            return result;
        }
        case OrbitMeasure::half_range: {
            MeasuredValue high = extremum(coordinate, 1.0);
            const MeasuredValue low = extremum(coordinate, -1.0);
            high.value = 0.5 * (high.value - low.value);
            high.by_parameters = 0.5 * (high.by_parameters - low.by_parameters);
            return high;
        }
        case OrbitMeasure::frequency:
            break;
    }
    return frequency_;
}

}  // namespace orbid::periodic
