#include "periodic/orbit/orbit_amplitude.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// Instants per period of the forcing or return, and where these do not resolve the motion.
constexpr std::size_t instants_per_period = 32;
constexpr std::size_t more_instants = 512;
/// They resolve it if every other one gives the same mean and mean square, relative to the largest square.
constexpr double resolution = 1e-7;
/// The rest of the way to an extremum is a parabola's once it is below this share of the range; it errs by less.
constexpr double parabolic = 1e-8;
constexpr int most_trials = 30;

/// An orbit at equal instants.
struct Course {
    const models::System& system;
    const VectorXd& theta;
    const models::FlowOptions& options;
    models::Clock clock;
    MatrixXd states;             ///< shape (n, instants)
    MatrixXd slopes;             ///< by time, like states
    std::vector<double> phases;  ///< of the instants
    double step;                 ///< from instant to instant, on the clock
    double seconds;              ///< likewise [s]

    /// Coordinate i is stationary between instants k and k + 1: how much larger it is there than at k.
    [[nodiscard]] double rise_to_extremum(Index i, Index k, Index next, double range) const {
        // The secant method on the slope of the true motion, kept between instants of other signs.
        const VectorXd start = states.col(k);
        const double phase = phases[static_cast<std::size_t>(k)];
        double low = 0.0, high = 1.0, before = 0.0, slope_before = slopes(i, k), rise = 0.0;
        double s = slopes(i, k) / (slopes(i, k) - slopes(i, next));
        for (int trial = 0; trial < most_trials; ++trial) {
            const double durations[] = {s * step};
            const models::FlowResult flow = system.flow(start, phase, durations, theta, clock, options);
            if (flow.status != models::FlowStatus::ok) break;
            const double at = clock == models::Clock::phase ? phase + durations[0] : phase;
            const double slope = system.rhs(flow.states, std::vector<double>{at}, theta)(i, 0);
            rise = flow.states(i, 0) - start(i);
            (slope * slopes(i, k) > 0.0 ? low : high) = s;
            if (slope == slope_before) break;
            double to = s - slope * (s - before) / (slope - slope_before);
            const double rest = 0.5 * slope * (to - s) * seconds;
            if (std::abs(rest) <= parabolic * range) {
                rise += rest;
                break;
            }
            if (!(to > low && to < high)) to = 0.5 * (low + high);
            before = std::exchange(s, to);
            slope_before = slope;
        }
        return rise;
    }
};

void measure(VectorXd x, bool angle, Index i, const Course* course, OrbitAmplitude& result) {
    const Index count = x.size();
    if (angle) x.array() -= full_turn * std::round(x.mean() / full_turn);
    double lowest = x.minCoeff();
    double highest = x.maxCoeff();
    for (Index k = 0; course != nullptr && k < count; ++k) {
        const Index next = (k + 1) % count;
        // Between slopes of one sign the ends are the extrema, but for what rounding adds.
        if (!(course->slopes(i, k) * course->slopes(i, next) < 0.0)) continue;
        const double value = x(k) + course->rise_to_extremum(i, k, next, highest - lowest);
        lowest = std::min(lowest, value);
        highest = std::max(highest, value);
    }
    result.maximum(i) = highest;
    result.minimum(i) = lowest;
    result.mean(i) = x.mean();
    result.half_range(i) = 0.5 * (highest - lowest);
    result.rms(i) = std::sqrt(x.squaredNorm() / static_cast<double>(count));
}

bool resolved(const SampledMesh& samples) {
    const MatrixXd& states = samples.states;
    for (Index i = 0; i < states.rows(); ++i) {
        if (samples.turns(i) != 0.0) continue;
        const Eigen::ArrayXd x = states.row(i).array() - states.row(i).mean();
        const Eigen::ArrayXd half = x(Eigen::seq(0, Eigen::last, 2));
        const double size = x.abs().maxCoeff();
        if (std::abs(half.mean()) > resolution * size) return false;
        if (std::abs(half.square().mean() - x.square().mean()) > resolution * size * size) return false;
    }
    return true;
}

OrbitAmplitude undefined(Index n) {
    const VectorXd nan = VectorXd::Constant(n, std::numeric_limits<double>::quiet_NaN());
    return {nan, nan, nan, nan, nan};
}

}  // namespace

OrbitAmplitude amplitude_of(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh,
                            const models::FlowOptions& options) {
    const Index n = mesh.nodes.rows();
    const auto table = system.coordinates();
    if (system.kind() == models::Kind::map) {
        OrbitAmplitude result = undefined(n);
        for (Index i = 0; i < n; ++i)
            measure(mesh.nodes.row(i), false, i, nullptr, result);
        return result;
    }
    const bool forced = system.kind() == models::Kind::forced;
    double duration = mesh.time;
    if (forced) {
        duration = 0.0;
        for (const Segment& segment : mesh.segments)
            duration += segment.duration;
    }
    std::vector<double> shares, phases;
    SampledMesh samples;
    for (const std::size_t per_period : {instants_per_period, more_instants}) {
        const std::size_t count = per_period * std::max<std::size_t>(mesh.points.size(), 1);
        shares.clear();
        phases.clear();
        for (std::size_t k = 0; k < count; ++k) {
            shares.push_back(static_cast<double>(k) / static_cast<double>(count));
            phases.push_back(forced ? mesh.segments.front().phase + duration * shares.back() : 0.0);
        }
        samples = sampled(system, theta, mesh, shares, options);
        if (!samples.simulated) return {};
        if (resolved(samples)) break;
    }
    const MatrixXd slopes = system.rhs(samples.states, phases, theta);
    const double step = duration / static_cast<double>(phases.size());
    const double second = forced
                              ? system.period(theta, models::Clock::phase) / system.period(theta, models::Clock::time)
                              : 1.0;  // on the clock
    const Course course{system, theta, options, mesh.clock, samples.states, slopes, phases, step, step / second};
    OrbitAmplitude result = undefined(n);
    for (Index i = 0; i < n; ++i)
        if (samples.turns(i) == 0.0)
            measure(samples.states.row(i), table[static_cast<std::size_t>(i)].angle, i, &course, result);
    return result;
}

OrbitAmplitude amplitude_of(const models::System& system, const VectorXd& theta, double phase,
                            const PeriodicOrbit& orbit, const models::FlowOptions& options) {
    const Index p = orbit.points.cols();
    const bool forced = system.kind() == models::Kind::forced;
    ShootingMesh mesh;
    mesh.simulated = true;
    mesh.clock = forced ? models::Clock::phase : models::Clock::time;
    mesh.nodes = orbit.points;
    mesh.time = orbit.time;
    const bool timed = system.kind() == models::Kind::autonomous && orbit.times.size() == p;
    for (Index j = 0; j < p; ++j) {
        double share = 1.0 / static_cast<double>(p);
        if (timed) share = ((j + 1 < p ? orbit.times(j + 1) : orbit.time) - orbit.times(j)) / orbit.time;
        const double duration = forced ? system.period(theta, models::Clock::phase) : share * orbit.time;
        mesh.segments.push_back({phase, duration, share});
        mesh.points.push_back(j);
    }
    return amplitude_of(system, theta, mesh, options);
}

}  // namespace orbid::periodic
