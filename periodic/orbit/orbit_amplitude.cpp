#include "periodic/orbit/orbit_amplitude.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// Instants per period of the forcing or return. Extrema are then known to 1e-9 of a motion of one harmonic.
constexpr std::size_t instants_per_period = 512;

/// Values of a coordinate at equal instants over an orbit, and their slopes times the distance of the instants.
struct Course {
    VectorXd values;
    VectorXd slopes;  ///< empty for maps
};

/// Takes the cubic between two instants into the extrema: its own are zeros of its derivative a s^2 + b s + c.
void include_cubic(double x0, double x1, double v0, double v1, double& lowest, double& highest) {
    const double a = 3.0 * (2.0 * (x0 - x1) + v0 + v1);
    const double b = 2.0 * (3.0 * (x1 - x0) - 2.0 * v0 - v1);
    const double root = std::sqrt(std::max(b * b - 4.0 * a * v0, 0.0));
    const double q = -0.5 * (b + std::copysign(root, b));
    for (const double s : {q / a, v0 / q}) {
        if (!(s > 0.0 && s < 1.0)) continue;
        const double value = x0 + s * (v0 + s * (0.5 * b + s * a / 3.0));
        lowest = std::min(lowest, value);
        highest = std::max(highest, value);
    }
}

void measure(Course course, bool angle, Index i, OrbitAmplitude& result) {
    VectorXd& x = course.values;
    const Index count = x.size();
    if (angle) x.array() -= full_turn * std::round(x.mean() / full_turn);
    double lowest = x.minCoeff();
    double highest = x.maxCoeff();
    for (Index k = 0; k < course.slopes.size(); ++k) {
        const Index next = (k + 1) % count;
        // Between slopes of one sign the ends are the extrema, but for what rounding adds.
        if (course.slopes(k) * course.slopes(next) < 0.0)
            include_cubic(x(k), x(next), course.slopes(k), course.slopes(next), lowest, highest);
    }
    result.maximum(i) = highest;
    result.minimum(i) = lowest;
    result.mean(i) = x.mean();
    result.half_range(i) = 0.5 * (highest - lowest);
    result.rms(i) = std::sqrt(x.squaredNorm() / static_cast<double>(count));
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
            measure({mesh.nodes.row(i).transpose(), {}}, false, i, result);
        return result;
    }
    const std::size_t count = instants_per_period * std::max<std::size_t>(mesh.points.size(), 1);
    double duration = 0.0;
    for (const Segment& segment : mesh.segments)
        duration += segment.duration;
    std::vector<double> shares, phases;
    for (std::size_t k = 0; k < count; ++k) {
        shares.push_back(static_cast<double>(k) / static_cast<double>(count));
        const bool forced = system.kind() == models::Kind::forced;
        phases.push_back(forced ? mesh.segments.front().phase + duration * shares.back() : 0.0);
    }
    const SampledMesh samples = sampled(system, theta, mesh, shares, options);
    if (!samples.simulated) return {};
    const MatrixXd slopes = system.rhs(samples.states, phases, theta) * (mesh.time / static_cast<double>(count));
    OrbitAmplitude result = undefined(n);
    for (Index i = 0; i < n; ++i)
        if (samples.turns(i) == 0.0)
            measure({samples.states.row(i).transpose(), slopes.row(i).transpose()},
                    table[static_cast<std::size_t>(i)].angle, i, result);
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
