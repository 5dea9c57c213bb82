#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "models/arithmetic/median.hpp"
#include "orbits/simulation/section_record.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t returns = 64;
/// Instants at which the size of the states is looked at: eight per return.
constexpr std::size_t instants_looked_at = 512;
constexpr int probe_rounds = 6;
constexpr double generous = 100.0;
/// Steps of one return: a probe must not take longer than a simulation. A hundred times what a return needs.
constexpr std::size_t step_budget = 10000;

/// Median time [s] in which a start changes by its own size, at least 1e-3 of a unit; empty where all stand still.
std::optional<double> time_of_change(const models::System& system, const Eigen::VectorXd& theta,
                                     const Eigen::MatrixXd& starts) {
    const std::vector<double> phases(static_cast<std::size_t>(starts.cols()), 0.0);
    const Eigen::MatrixXd slopes = system.rhs(starts, phases, theta);
    std::vector<double> times;
    for (Eigen::Index i = 0; i < starts.cols(); ++i) {
        const double rate = (slopes.col(i).array().abs() / (starts.col(i).array().abs() + 1e-3)).maxCoeff();
        if (rate > 0.0 && std::isfinite(rate)) times.push_back(1.0 / rate);
    }
    if (times.empty()) return std::nullopt;
    return models::upper_median(std::move(times));
}

/// Instants evenly spread from 0 to the end.
std::vector<double> instants_until(double end, std::size_t count) {
    std::vector<double> durations(count);
    for (std::size_t k = 0; k < count; ++k)
        durations[k] = end * static_cast<double>(k) / static_cast<double>(count - 1);
    return durations;
}

/// Angles reach around the circle; 1 for a coordinate that stays at 0.
void complete_range(const models::System& system, Eigen::VectorXd& range) {
    for (Eigen::Index i = 0; i < range.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) range[i] = std::numbers::pi;
        if (!(range[i] > 0.0)) range[i] = 1.0;
    }
}

/// Largest absolute values on the way of a trajectory, sampled until `end`; 0 where it cannot be followed.
Eigen::VectorXd size_of(const models::System& system, const Eigen::VectorXd& theta, const Eigen::VectorXd& start,
                        double end, const models::FlowOptions& flow) {
    const std::vector<double> durations = instants_until(end, instants_looked_at);
    models::FlowOptions whole = flow;
    whole.maximum_steps *= returns;
    const auto run = system.flow(start, 0.0, durations, theta, models::Clock::time, whole);
    if (run.status != models::FlowStatus::ok) return Eigen::VectorXd::Zero(start.size());
    return run.states.cwiseAbs().rowwise().maxCoeff();
}

}  // namespace

ReturnProbe probe_returns(const models::System& system, const Eigen::VectorXd& theta, const models::Section& section,
                          const Eigen::MatrixXd& starts, const models::FlowOptions& flow) {
    models::FlowOptions limited = flow;
    limited.maximum_steps = std::min(flow.maximum_steps, step_budget);
    const auto change = time_of_change(system, theta, starts);
    ReturnProbe probe;
    probe.longest_return = 10.0 * change.value_or(1.0);
    probe.range = starts.cwiseAbs().rowwise().maxCoeff();
    const auto count = static_cast<std::size_t>(starts.cols());
    for (int round = 0; round < probe_rounds; ++round) {
        const auto run = system.crossing_ensemble(starts, section, returns, probe.longest_return, theta, limited);
        std::vector<double> times;
        std::vector<double> ends(count, 0.0);
        std::size_t complete = 0;
        for (std::size_t i = 0; i < count; ++i) {
            if (run.status[i] != models::FlowStatus::ok) continue;
            ++complete;
            const Eigen::VectorXd& at = run.times[i];
            ends[i] = at[at.size() - 1];
            // The way from the start to the section is no return.
            for (Eigen::Index k = 2; k < at.size(); ++k)
                times.push_back(at[k] - at[k - 1]);
        }
        const bool enough = 4 * complete >= count && complete > 0;
        if (!enough && round + 1 < probe_rounds) {
            probe.longest_return *= 10.0;
            continue;
        }
        if (complete == 0) break;
        probe.longest_return = generous * models::upper_median(std::move(times));
        std::vector<Eigen::VectorXd> sizes(count, Eigen::VectorXd::Zero(starts.rows()));
        oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
            if (ends[i] > 0.0)
                sizes[i] = size_of(system, theta, starts.col(static_cast<Eigen::Index>(i)), ends[i], limited);
        });
        probe.range.setZero();
        for (const Eigen::VectorXd& size : sizes)
            probe.range = probe.range.cwiseMax(size);
        break;
    }
    complete_range(system, probe.range);
    return probe;
}

Eigen::MatrixXd probe_starts(const models::System& system, const Eigen::VectorXd& half, std::uint64_t seed) {
    Eigen::MatrixXd starts(system.dimension(), probe_count);
    for (Eigen::Index p = 0; p < probe_count; ++p) {
        estimator::RandomStream stream(seed, estimator::RandomPurpose::range_probe, static_cast<std::uint64_t>(p));
        for (Eigen::Index i = 0; i < starts.rows(); ++i) {
            const bool angle = system.coordinates()[static_cast<std::size_t>(i)].angle;
            starts(i, p) =
                angle ? stream.uniform(-std::numbers::pi, std::numbers::pi) : stream.uniform(-half[i], half[i]);
        }
    }
    return starts;
}

Eigen::VectorXd typical_range(const models::System& system, const Eigen::VectorXd& theta, double phase, double duration,
                              std::uint64_t seed, const models::FlowOptions& flow) {
    constexpr std::size_t periods = 64;
    constexpr std::size_t looks = 256;         // instants at which a system without sections is looked at
    constexpr std::size_t hopeless_part = 16;  // of all steps, when spent before the first look
    const Eigen::Index n = system.dimension();
    const Eigen::MatrixXd starts = probe_starts(system, Eigen::VectorXd::Constant(n, system.state_size()), seed);
    Eigen::VectorXd range = Eigen::VectorXd::Zero(n);
    if (system.kind() == models::Kind::autonomous) {
        const std::vector<double> durations = instants_until(duration, looks);
        const std::vector<double> first_look{durations[1]};
        models::FlowOptions start_only = flow;
        start_only.maximum_steps = std::max(std::size_t{1}, flow.maximum_steps / hopeless_part);
        std::vector<Eigen::VectorXd> reached(probe_count, Eigen::VectorXd::Zero(n));
        oneapi::tbb::parallel_for(Eigen::Index{0}, probe_count, [&](Eigen::Index p) {
            const auto begin = system.flow(starts.col(p), phase, first_look, theta, models::Clock::time, start_only);
            if (begin.status != models::FlowStatus::ok) return;
            const auto result = system.flow(starts.col(p), phase, durations, theta, models::Clock::time, flow);
            if (result.status == models::FlowStatus::ok)
                reached[static_cast<std::size_t>(p)] = result.states.cwiseAbs().rowwise().maxCoeff();
        });
        for (const auto& values : reached)
            range = range.cwiseMax(values);
    } else {
        const auto result = system.ensemble(starts, phase, periods, theta, flow);
        for (std::size_t p = 0; p < result.sections.size(); ++p) {
            if (result.status[p] != models::FlowStatus::ok) continue;
            range = range.cwiseMax(result.sections[p].cwiseAbs().rowwise().maxCoeff());
        }
    }
    complete_range(system, range);
    return range;
}

}  // namespace orbid::orbits
