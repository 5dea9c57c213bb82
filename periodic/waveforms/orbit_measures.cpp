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

}  // namespace

OrbitReadings::OrbitReadings(const models::System& system, const VectorXd& theta, const PeriodicOrbit& orbit,
                             const models::Sensor& sensor, std::optional<std::span<const Index>> free,
                             const models::FlowOptions& options) {
    Index count = fewest;
    for (;; count *= 2) {
        simulated_ = read(system, theta, orbit, sensor, std::nullopt, count, options);
        if (!simulated_ || count == most || resolved()) break;
    }
    // Derivatives cost many times more than readings.
    if (simulated_ && free) simulated_ = read(system, theta, orbit, sensor, free, count, options);
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
                         const models::Sensor& sensor, std::optional<std::span<const Index>> free, Index count,
                         const models::FlowOptions& options) {
    const SolvedCurve curve(system, theta, orbit, options);
    const bool forced = system.kind() == models::Kind::forced;
    std::vector<double> places(static_cast<std::size_t>(count));
    for (std::size_t k = 0; k < places.size(); ++k)
        places[k] = curve.length() * static_cast<double>(k) / static_cast<double>(count);
    const CurveStates at = curve.states(places, free);
    if (!at.simulated) return false;
    const auto read = system.readings(sensor, at.states, places, theta, free, options);
    if (read.status != models::FlowStatus::ok || !read.readings.allFinite()) return false;
    readings_ = read.readings;
    const Index n = readings_.rows();
    const auto f = free ? std::ssize(*free) : Index{0};
    by_parameters_.resize(n, count * f);
    for (Index k = 0; f > 0 && k < count; ++k) {
        MatrixXd state = at.by_parameters.middleCols(k * f, f);
        // A place is a time: the same share of the orbit moves with T.
        const double share = static_cast<double>(k) / static_cast<double>(count);
        if (!forced) state += share * at.velocity.col(k) * orbit.time_sensitivities;
        const auto derivative = read.derivatives.middleCols(k * (n + f), n + f);
        by_parameters_.middleCols(k * f, f) = derivative.leftCols(n) * state + derivative.rightCols(f);
    }
    turning_.assign(static_cast<std::size_t>(n), false);
    for (Index i = 0; i < n; ++i) {
        if (!models::reads_angle(sensor, system.coordinates(), static_cast<std::size_t>(i))) continue;
        const double first = readings_(i, 0);
        for (Index k = 1; k < count; ++k)
            readings_(i, k) -= full_turn * std::round((readings_(i, k) - readings_(i, k - 1)) / full_turn);
        const double last = readings_(i, count - 1);
        turning_[static_cast<std::size_t>(i)] = std::round((last - first) / full_turn) != 0.0;
        readings_.row(i).array() -= full_turn * std::round(readings_.row(i).mean() / full_turn);
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
