#include "orbits/simulation/node_state.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/definition/parameter.hpp"
#include "orbits/simulation/initial_state.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Row of a series for each coordinate of the model, -1 where it has none.
std::vector<Index> rows_of(const models::System& system, const Series& series) {
    std::vector<Index> rows(system.coordinates().size(), -1);
    for (Index row = 0; row < series.dimension(); ++row) {
        const Index index = system.coordinate_index(series.coordinate(row).name);
        if (index >= 0) rows[static_cast<std::size_t>(index)] = row;
    }
    return rows;
}

/// All coordinates are read: columns of readings to columns of states.
MatrixXd states_with_readings(const models::System& system, const VectorXd& theta, const models::Sensor& sensor,
                              const std::vector<double>& phases, const MatrixXd& wanted) {
    // The error of a difference quotient falls by delay times the damping rate in each round, 1e-3 and less.
    constexpr int rounds = 6;
    constexpr double enough = 1e-12;  // of the state: below the rounding of any instrument
    MatrixXd x = wanted;
    for (int round = 0; round < rounds; ++round) {
        const auto read = system.readings(sensor, x, phases, theta);
        MatrixXd change = wanted - read.readings;
        bool settled = true;
        for (Index k = 0; k < x.cols(); ++k)
            for (Index i = 0; i < x.rows(); ++i) {
                if (models::reads_angle(sensor, system.coordinates(), static_cast<std::size_t>(i)))
                    change(i, k) = models::wrapped(change(i, k));
                if (!std::isfinite(change(i, k))) continue;  // no reading, or a state that cannot be read
                x(i, k) += change(i, k);
                settled = settled && std::abs(change(i, k)) <= enough * (1.0 + std::abs(x(i, k)));
            }
        if (settled) break;
    }
    return x;
}

struct NodeStates {
    MatrixXd states;
    std::vector<char> known;  ///< per node
};

/// Times tell slopes, and with them what is not read at a sample.
void take_slopes(const models::System& system, const VectorXd& theta, const Series& series, const Segment& data,
                 const models::Sensor& sensor, std::span<const Index> samples, NodeStates& nodes) {
    constexpr Index window = 65;  // samples: the widest polynomial of slope_at_start()
    const std::vector<Index> rows = rows_of(system, series);
    std::vector<Index> coordinates;
    for (Index i = 0; i < std::ssize(rows); ++i)
        if (rows[static_cast<std::size_t>(i)] >= 0) coordinates.push_back(i);
    if (coordinates.empty()) return;
    oneapi::tbb::parallel_for(std::size_t{0}, samples.size(), [&](std::size_t k) {
        if (nodes.known[k] != 0) return;
        const Index first = samples[k];
        const Index length = std::min(window, data.values.cols() - first);
        Segment rest{data.label, MatrixXd(std::ssize(coordinates), length), data.times.segment(first, length), {}};
        for (std::size_t i = 0; i < coordinates.size(); ++i)
            rest.values.row(static_cast<Index>(i)) =
                data.values.row(rows[static_cast<std::size_t>(coordinates[i])]).segment(first, length);
        for (Index i = 0; i < rest.values.rows(); ++i)
            if (rest.values.row(i).array().isFinite().count() < 2) return;
        const double phase = phase_at(system, theta, series, data, first);
        nodes.states.col(static_cast<Index>(k)) = initial_state(system, theta, {rest, coordinates, sensor, phase});
        nodes.known[k] = 1;
    });
}

}  // namespace

double phase_rate(const models::System& system, const Eigen::VectorXd& theta) {
    if (system.kind() == models::Kind::forced)
        return 2.0 * std::numbers::pi / system.period(theta, models::Clock::time);
    return system.inputs().empty() ? 0.0 : 1.0;
}

double phase_at(const models::System& system, const VectorXd& theta, const Series& series, const Segment& segment,
                Index sample) {
    if (series.sampling == Series::Sampling::section && system.kind() == models::Kind::forced) return series.phase;
    if (segment.times.size() == 0) return 0.0;
    return series.phase + phase_rate(system, theta) * segment.times[sample];
}

MatrixXd node_states(const models::System& system, const VectorXd& theta, const Series& series, std::size_t segment,
                     const models::Sensor& sensor, std::span<const Index> samples) {
    constexpr double missing = std::numeric_limits<double>::quiet_NaN();
    const Segment& data = series.segments[segment];
    const Index n = system.dimension(), count = std::ssize(samples);
    const std::vector<Index> rows = rows_of(system, series);
    std::vector<double> phases;
    for (const Index k : samples)
        phases.push_back(phase_at(system, theta, series, data, k));

    NodeStates nodes{MatrixXd::Constant(n, count, missing), std::vector<char>(samples.size(), 0)};
    auto& [states, known] = nodes;
    if (sensor.type != models::Sensor::Type::function && std::find(rows.begin(), rows.end(), -1) == rows.end()) {
        MatrixXd readable(n, count);
        for (Index k = 0; k < count; ++k) {
            const auto here = static_cast<std::size_t>(k);
            for (Index i = 0; i < n; ++i)
                readable(i, k) = data.values(rows[static_cast<std::size_t>(i)], samples[here]);
            known[here] = readable.col(k).allFinite() ? 1 : 0;
            if (known[here] == 0) readable.col(k).setZero();
        }
        states = states_with_readings(system, theta, sensor, phases, readable);
    }
    if (data.times.size() > 0) take_slopes(system, theta, series, data, sensor, samples, nodes);
    // What is left follows from the sample before.
    const bool sections = data.times.size() == 0;
    const bool forced = system.kind() == models::Kind::forced;
    const models::Clock clock = sections && forced ? models::Clock::phase : models::Clock::time;
    for (Index k = 1; k < count; ++k) {
        const auto here = static_cast<std::size_t>(k);
        if (known[here] != 0 || known[here - 1] == 0) continue;
        const double steps = static_cast<double>(samples[here] - samples[here - 1]);
        const std::array<double, 1> duration{!sections
                                                 ? data.times[samples[here]] - data.times[samples[here - 1]]
                                                 : steps * (forced ? system.period(theta, models::Clock::phase) : 1.0)};
        const auto flow = system.flow(states.col(k - 1), phases[here - 1], duration, theta, clock, {1e-9, 1e-9, 20000});
        if (flow.status != models::FlowStatus::ok) continue;
        states.col(k) = flow.states.col(0);
        known[here] = 1;
    }
    for (Index k = count - 1; k > 0; --k) {
        const auto before = static_cast<std::size_t>(k - 1);
        if (known[before] != 0) continue;
        states.col(k - 1) = states.col(k);
        known[before] = known[before + 1];
    }
    for (Index k = 0; k < count; ++k)
        if (known[static_cast<std::size_t>(k)] == 0) states.col(k).setConstant(missing);
    return std::move(states);
}

}  // namespace orbid::orbits
