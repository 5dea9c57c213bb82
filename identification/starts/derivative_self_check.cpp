#include "identification/starts/derivative_self_check.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "models/system/derivative_check.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_map.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::identification {

namespace {

constexpr Eigen::Index most_directions = 100;
// Long enough that every term of the equations has acted, short enough that chaos has not.
constexpr Eigen::Index most_intervals = 10;

std::optional<FlowStart> of_series(const Experiment& experiment, const orbits::SeriesResidual& residual,
                                   const models::ParameterBinding& binding, const Eigen::VectorXd& start) {
    const std::size_t index = residual.segment(0);
    const orbits::Segment& segment = residual.series().segments[index];
    FlowStart flow;
    flow.system = experiment.inputs.empty() ? nullptr : residual.system().with_input(experiment.inputs[index]);
    flow.theta = binding.values(start);
    flow.free = binding.parameter;
    flow.state = residual.guessed_state(0);
    flow.phase = residual.series().phase + orbits::phase_rate(residual.system(), flow.theta) * segment.times[0];
    for (Eigen::Index k = 1; k < std::min(segment.times.size(), most_intervals + 1); ++k)
        flow.durations.push_back(segment.times[k] - segment.times[0]);
    if (flow.durations.empty()) return std::nullopt;
    return flow;
}

/// Over one interval of a series with nodes.
std::optional<FlowStart> of_transition(const IdentificationProblem& problem, std::size_t experiment,
                                       const models::ParameterBinding& binding, const Eigen::VectorXd& start,
                                       std::uint64_t seed) {
    FlowStart flow;
    flow.theta = binding.values(start);
    flow.free = binding.parameter;
    const Experiment& data = problem.experiments[experiment];
    const auto systems = systems_with(problem.system, data.inputs);
    const auto list =
        orbits::transitions(systems, flow.theta, *data.series, data.sensor, data.fitted_segments(), 1, 1, seed);
    if (list.empty()) return std::nullopt;
    flow.system = data.inputs.empty() ? problem.system : systems[list.front().segment];
    flow.state = list.front().from;
    flow.phase = list.front().phase;
    flow.durations = {list.front().duration};
    flow.clock = orbits::transition_clock(*problem.system, *data.series);
    return flow;
}

/// From the first periodic solution there is, over a tenth of it.
std::optional<FlowStart> of_orbits(const periodic::SteadyStateResidual& residual, const Eigen::VectorXd& start) {
    const auto orbits = residual.solutions(residual.initial_set(), start);
    for (std::size_t b = 0; b < orbits.size(); ++b) {
        if (orbits[b].status != periodic::OrbitStatus::converged) continue;
        FlowStart flow;
        flow.theta = residual.binding(b).values(start);
        flow.free = residual.binding(b).parameter;
        flow.state = orbits[b].points.col(0);
        flow.durations = {0.1 * orbits[b].time};
        return flow;
    }
    return std::nullopt;
}

FlowStart of_cycle(const models::System& system, const orbits::Cycle& cycle, const orbits::SectionPlace& place,
                   const models::ParameterBinding& binding, const Eigen::VectorXd& start) {
    FlowStart flow;
    flow.theta = binding.values(start);
    flow.free = binding.parameter;
    flow.state = orbits::SectionMap(system, place, {}).states(cycle.points.col(0));
    flow.phase = place.phase;
    const bool forced = system.kind() == models::Kind::forced;
    flow.clock = forced ? models::Clock::phase : models::Clock::time;
    flow.durations = {forced ? system.period(flow.theta, flow.clock) : 1.0};
    return flow;
}

}  // namespace

std::optional<FlowStart> first_flow(const IdentificationProblem& problem, const EstimateSetup& setup,
                                    const ProblemResiduals& residuals, const models::ParameterBinding& cycle_binding,
                                    std::uint64_t seed) {
    std::optional<FlowStart> flow;
    if (!residuals.series.empty()) {
        const std::size_t experiment = residuals.experiments.front();
        flow = of_series(problem.experiments[experiment], *residuals.series.front(), setup.experiments[experiment],
                         setup.start());
    } else if (residuals.waveform.residual) {
        flow = of_orbits(*residuals.waveform.residual, setup.start());
    } else if (residuals.branch) {
        flow = of_orbits(*residuals.branch, setup.start());
    } else if (problem.cycles && !problem.measured.search.cycles.empty()) {
        flow = of_cycle(*problem.system, problem.measured.search.cycles.front(), problem.measured.place(),
                        cycle_binding, setup.start());
    } else if (problem.series) {
        const std::size_t experiment = problem.series->data.front();
        flow = of_transition(problem, experiment, setup.experiments[experiment], setup.start(), seed);
    }
    if (flow && !flow->system) flow->system = problem.system;
    if (flow && !(flow->state.allFinite() && flow->theta.allFinite())) return std::nullopt;
    return flow;
}

std::string compare_derivatives(const FlowStart& start) {
    const Eigen::Index directions = start.state.size() + static_cast<Eigen::Index>(start.free.size());
    if (directions > most_directions)
        return fmt::format("derivatives of the model were not compared with differences: {} directions, at most {}",
                           directions, most_directions);
    const auto check = models::check_derivatives(*start.system, start.state, start.phase, start.durations, start.theta,
                                                 start.free, start.clock);
    if (!check.passed)
        throw WrongModel(
            fmt::format("model {}: its derivatives are not those of its equations: {}; a branch on a value, or a "
                        "number that is no scalar of the template, loses derivatives",
                        start.system->name(), check.message));
    return fmt::format("{}{}", check.message,
                       check.inconclusive > 0 ? fmt::format(", {} undecided", check.inconclusive) : "");
}

}  // namespace orbid::identification
