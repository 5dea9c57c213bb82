#include "identification/problem/cycle_orbits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"
#include "orbits/sections/plane_choice.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;

/// Places per orbit at which waveforms are compared.
constexpr Index shares_of_time = 256;
constexpr double largest_misfit = 0.1;
/// Of a stretch: the orbit may be far from the motion, which need not be chaotic at the start of the parameters.
constexpr double largest_coarse_misfit = 0.4;
/// T of the model's orbits over that of the cycles.
constexpr std::array<double, 9> stretches{1.0, 0.96, 1.04, 0.92, 1.08, 0.86, 1.14, 0.8, 1.22};
constexpr double largest_ratio = 1.35;
/// Stretches of the model's motion from which the orbit of a cycle is solved, and places at which they are compared.
constexpr std::size_t tried = 12;
constexpr Index coarse_places = 64;
/// Of the model's own motion: samples per T of the shortest cycle, their number, and those before the first.
constexpr double samples_per_time = 64.0;
constexpr std::size_t simulated = std::size_t{1} << 16U;
constexpr std::size_t transient = 8192;
constexpr std::uint64_t most_seeds = 8;
constexpr models::FlowOptions coarse_flow{1e-8, 1e-8, 100000};

/// The model's own motion, and a plane that it crosses.
struct Motion {
    Eigen::VectorXd times;
    Eigen::MatrixXd states, readings;
    models::Section plane;
};

std::optional<Eigen::MatrixXd> read_rows(const models::System& system, const Eigen::VectorXd& theta,
                                         const Eigen::MatrixXd& states, const std::vector<Index>& coordinates,
                                         const models::Sensor& sensor) {
    const std::vector<double> phases(static_cast<std::size_t>(states.cols()), 0.0);
    const auto read = system.readings(sensor, states, phases, theta, std::nullopt, coarse_flow);
    if (read.status != models::FlowStatus::ok || !read.readings.allFinite()) return std::nullopt;
    Eigen::MatrixXd rows(std::ssize(coordinates), states.cols());
    for (std::size_t c = 0; c < coordinates.size(); ++c)
        rows.row(static_cast<Index>(c)) = read.readings.row(coordinates[c]);
    return rows;
}

Motion simulated_motion(const models::System& system, const Eigen::VectorXd& theta, double shortest,
                        const std::vector<Index>& coordinates, const models::Sensor& sensor) {
    for (std::uint64_t seed = 1; seed <= most_seeds; ++seed) {
        orbits::VirtualExperimentOptions options;
        options.plan = orbits::SamplePlan{shortest / samples_per_time, simulated, transient};
        options.seed = seed;
        const auto run = orbits::simulate(system, theta, options);
        if (!run.complete) continue;
        try {
            const auto plane = orbits::choose_plane(run.series);
            const orbits::Segment& segment = run.series.segments.front();
            const Eigen::MatrixXd states(segment.values);
            auto rows = read_rows(system, theta, states, coordinates, sensor);
            if (!rows) continue;
            return {segment.times, states, std::move(*rows),
                    models::Section{Eigen::VectorXd::Unit(system.dimension(), plane.crossing.coordinate),
                                    plane.crossing.value, plane.crossing.direction}};
        } catch (const orbits::DataError&) {
            // At rest from here: others may move.
        }
    }
    throw orbits::DataError(
        fmt::format("the model {} has no lasting motion at the start of the parameters: cycles find no orbits there",
                    system.name()));
}

/// The readings of an orbit at equal shares of T, rows as those of the waveforms; empty if it cannot be followed.
Eigen::MatrixXd readings_of(const models::System& system, const Eigen::VectorXd& theta,
                            const periodic::PeriodicOrbit& orbit, const std::vector<Index>& coordinates,
                            const models::Sensor& sensor) {
    // From point to point: an unstable orbit is left otherwise.
    Eigen::MatrixXd states(system.dimension(), shares_of_time);
    const Index points = orbit.points.cols();
    Index next = 0;
    for (Index j = 0; j < points; ++j) {
        const double begin = orbit.times(j) - orbit.times(0);
        const double end = j + 1 < points ? orbit.times(j + 1) - orbit.times(0) : orbit.time;
        std::vector<double> durations;
        const Index first = next;
        for (; next < shares_of_time; ++next) {
            const double at = orbit.time * static_cast<double>(next) / static_cast<double>(shares_of_time);
            if (at >= end && j + 1 < points) break;
            durations.push_back(std::max(at - begin, 0.0));
        }
        if (durations.empty()) continue;
        const auto flow = system.flow(orbit.points.col(j), 0.0, durations, theta, models::Clock::time, coarse_flow);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return {};
        states.middleCols(first, next - first) = flow.states;
    }
    return read_rows(system, theta, states, coordinates, sensor).value_or(Eigen::MatrixXd());
}

/// A waveform at equal shares of its period.
Eigen::MatrixXd evenly(const orbits::CycleWaveform& waveform) {
    const Index count = waveform.times.size();
    Eigen::MatrixXd rows(waveform.values.rows(), shares_of_time);
    Index at = 0;
    for (Index k = 0; k < shares_of_time; ++k) {
        const double time = waveform.time * static_cast<double>(k) / static_cast<double>(shares_of_time);
        while (at + 1 < count && waveform.times[at + 1] <= time)
            ++at;
        const double end = at + 1 < count ? waveform.times[at + 1] : waveform.time;
        const double share = (time - waveform.times[at]) / (end - waveform.times[at]);
        for (Index c = 0; c < rows.rows(); ++c) {
            const double one = waveform.values(c, at), other = waveform.values(c, (at + 1) % count);
            // Beside a missing reading its neighbour.
            rows(c, k) = !std::isfinite(one)     ? other
                         : !std::isfinite(other) ? one
                                                 : (1.0 - share) * one + share * other;
        }
    }
    return rows;
}

/// Mean square difference over the variances, at the best phase.
double misfit_of(const Eigen::MatrixXd& measured, const Eigen::MatrixXd& computed, const Eigen::VectorXd& variance) {
    double least = std::numeric_limits<double>::infinity();
    for (Index shift = 0; shift < shares_of_time; ++shift) {
        double sum = 0.0;
        for (Index k = 0; k < shares_of_time; ++k)
            sum += ((measured.col(k) - computed.col((k + shift) % shares_of_time)).array().square() / variance.array())
                       .sum();
        least = std::min(least, sum);
    }
    return least / static_cast<double>(shares_of_time * measured.rows());
}

Eigen::VectorXd variances(const std::vector<orbits::CycleWaveform>& waveforms) {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(waveforms.front().values.rows());
    Eigen::VectorXd square = sum;
    double number = 0.0;
    for (const auto& waveform : waveforms) {
        const Eigen::MatrixXd even = evenly(waveform);
        sum += even.rowwise().sum();
        square += even.cwiseAbs2().rowwise().sum();
        number += static_cast<double>(even.cols());
    }
    return (square / number - (sum / number).cwiseAbs2()).cwiseMax(1e-300);
}

/// A stretch of the model's motion whose readings are near those along a cycle.
struct Stretch {
    double misfit = 0.0;
    Index first = 0;
    double time = 0.0;
};

/// The nearest ones, best first, each somewhere else.
std::vector<Stretch> nearest_stretches(const Motion& motion, const orbits::CycleWaveform& waveform,
                                       const Eigen::MatrixXd& measured, const Eigen::VectorXd& variance) {
    const double step = motion.times[1] - motion.times[0];
    constexpr Index stride = shares_of_time / coarse_places;
    std::vector<Stretch> found;
    for (const double factor : stretches) {
        const double time = factor * waveform.time;
        std::array<Index, coarse_places> offsets{};
        for (Index k = 0; k < coarse_places; ++k)
            offsets[static_cast<std::size_t>(k)] =
                std::lround(time * static_cast<double>(k) / static_cast<double>(coarse_places) / step);
        for (Index i = 0; i + std::lround(time / step) < motion.times.size(); ++i) {
            constexpr double limit = largest_coarse_misfit * static_cast<double>(coarse_places);
            double sum = 0.0;
            for (Index k = 0; k < coarse_places && sum <= limit; ++k)
                sum += ((motion.readings.col(i + offsets[static_cast<std::size_t>(k)]) - measured.col(k * stride))
                            .array()
                            .square() /
                        variance.array())
                           .sum();
            if (sum <= limit) found.push_back({sum, i, time});
        }
    }
    std::sort(found.begin(), found.end(), [](const Stretch& a, const Stretch& b) {
        return std::tie(a.misfit, a.first, a.time) < std::tie(b.misfit, b.first, b.time);
    });
    std::vector<Stretch> apart;
    for (const Stretch& one : found) {
        const bool near = std::any_of(apart.begin(), apart.end(), [&](const Stretch& other) {
            return static_cast<double>(std::abs(one.first - other.first)) * step < 0.25 * waveform.time;
        });
        if (!near) apart.push_back(one);
        if (apart.size() == tried) break;
    }
    return apart;
}

/// Where a stretch crosses the plane; its beginning and T where it does not.
periodic::StartingSolution start_from(const models::System& system, const Eigen::VectorXd& theta, const Motion& motion,
                                      const Stretch& stretch) {
    constexpr std::size_t most_points = 32;
    periodic::StartingSolution start;
    start.time = stretch.time;
    const auto crossings = system.crossings(motion.states.col(stretch.first), motion.plane, most_points,
                                            2.0 * stretch.time, theta, std::nullopt, coarse_flow);
    // The crossing that is nearest to one T after the first closes the orbit; it is not a point of its own.
    Index count = 0;
    for (Index k = 1; k < crossings.states.cols(); ++k) {
        const auto off = [&](Index one) { return std::abs(crossings.times(one) - crossings.times(0) - stretch.time); };
        if (count == 0 || off(k) < off(count)) count = k;
    }
    if (count == 0) {
        start.points = motion.states.col(stretch.first);
    } else {
        start.points = crossings.states.leftCols(count);
        start.section = motion.plane;
        start.time = 0.0;
    }
    return start;
}

/// The model's orbit that is most like a cycle; nothing where none is near.
std::optional<PairedOrbit> nearest_orbit(const models::System& system, const Eigen::VectorXd& theta,
                                         const Motion& motion, const orbits::CycleWaveform& waveform,
                                         const std::vector<Index>& coordinates, const models::Sensor& sensor,
                                         const Eigen::VectorXd& variance) {
    const Eigen::MatrixXd measured = evenly(waveform);
    std::optional<PairedOrbit> best;
    for (const Stretch& stretch : nearest_stretches(motion, waveform, measured, variance)) {
        periodic::ShootingOptions options;
        options.maximum_distance = std::numeric_limits<double>::infinity();
        const periodic::StartingSolution start = start_from(system, theta, motion, stretch);
        const auto orbit = periodic::solve_orbit(system, theta, start, {}, options);
        if (orbit.status != periodic::OrbitStatus::converged) continue;
        const double ratio = orbit.time / waveform.time;
        if (ratio > largest_ratio || ratio < 1.0 / largest_ratio) continue;
        const Eigen::MatrixXd computed = readings_of(system, theta, orbit, coordinates, sensor);
        if (computed.size() == 0) continue;
        const double misfit = misfit_of(measured, computed, variance);
        if (misfit > largest_misfit || (best && misfit >= best->misfit)) continue;
        best.emplace();
        // One state and T: points of a waveform's orbit lie at fixed shares of T, which crossings do not.
        best->start.points = orbit.points.col(0);
        best->start.time = orbit.time;
        best->time = orbit.time;
        best->misfit = misfit;
    }
    return best;
}

}  // namespace

std::vector<std::optional<PairedOrbit>> paired_orbits(const models::System& system, const Eigen::VectorXd& theta,
                                                      const std::vector<orbits::CycleWaveform>& waveforms,
                                                      const std::vector<Index>& coordinates,
                                                      const models::Sensor& sensor) {
    std::vector<std::optional<PairedOrbit>> pairs(waveforms.size());
    if (waveforms.empty()) return pairs;
    const auto shortest = std::min_element(waveforms.begin(), waveforms.end(),
                                           [](const auto& a, const auto& b) { return a.time < b.time; });
    const Motion motion = simulated_motion(system, theta, shortest->time, coordinates, sensor);
    const Eigen::VectorXd variance = variances(waveforms);
    for (std::size_t w = 0; w < waveforms.size(); ++w)
        pairs[w] = nearest_orbit(system, theta, motion, waveforms[w], coordinates, sensor, variance);
    // Mirror images have one T, too; what else has it to ten digits is the same orbit.
    for (std::size_t w = 0; w < pairs.size(); ++w)
        for (std::size_t v = w + 1; v < pairs.size() && pairs[w]; ++v) {
            constexpr double same_time = 1e-9;
            if (!pairs[v] || std::abs(pairs[v]->time / pairs[w]->time - 1.0) > same_time) continue;
            const Eigen::MatrixXd one = evenly(waveforms[w]), other = evenly(waveforms[v]);
            if (misfit_of(one, other, variance) > largest_misfit) continue;
            (pairs[v]->misfit < pairs[w]->misfit ? pairs[w] : pairs[v]).reset();
        }
    return pairs;
}

}  // namespace orbid::identification
