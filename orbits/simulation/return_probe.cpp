#include "orbits/simulation/return_probe.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "models/arithmetic/median.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t returns = 64;
constexpr std::size_t instants_looked_at =
    512;  // instants at which the size of the states is looked at, eight per return
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

/// Largest absolute values on the way of a trajectory, sampled until `end`; 0 where it cannot be followed.
Eigen::VectorXd size_of(const models::System& system, const Eigen::VectorXd& theta, const Eigen::VectorXd& start,
                        double end, const models::FlowOptions& flow) {
    std::vector<double> durations(instants_looked_at);
    for (std::size_t k = 0; k < instants_looked_at; ++k)
        durations[k] = end * static_cast<double>(k) / (instants_looked_at - 1);
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
    for (Eigen::Index i = 0; i < probe.range.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) probe.range[i] = std::numbers::pi;
        if (!(probe.range[i] > 0.0)) probe.range[i] = 1.0;
    }
    return probe;
}

}  // namespace orbid::orbits
