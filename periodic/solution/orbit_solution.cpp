#include "periodic/solution/orbit_solution.hpp"

#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/newton.hpp"
#include "periodic/solution/orbit_report.hpp"
#include "periodic/stability/floquet.hpp"

namespace orbid::periodic {
namespace {

/// A prime number of times that an orbit of T runs through a shorter one, 2, 3, 5 or 7 (the largest that does); 1 where
/// it does not.
int repeats_in_time(const models::System& system, const VectorXd& theta, const VectorXd& x, double time,
                    const std::vector<Index>& angles, const VectorXd& scale, const models::FlowOptions& options) {
    // The flow over a part of an unstable orbit magnifies the error of the point, 1e-12, by less than its multiplier.
    constexpr double same_point = 1e-6;
    const std::vector<double> durations{time / 7.0, time / 5.0, time / 3.0, time / 2.0};
    const auto flow = system.flow(x, 0.0, durations, theta, models::Clock::time, options);
    if (flow.status != models::FlowStatus::ok) return 1;
    for (Index k = 0; k < flow.states.cols(); ++k)
        if (relative_size(wrapped_angles(flow.states.col(k) - x, angles), scale) < same_point)
            return static_cast<int>(std::lround(time / durations[static_cast<std::size_t>(k)]));
    return 1;
}

bool at_equilibrium(const OrbitProblem& problem, const MatrixXd& states, double time, const VectorXd& scale) {
    if (!problem.autonomous()) return false;
    // Orbits smaller than this fraction of the scale cannot be distinguished from the equilibrium they surround. Their
    // points are accurate to 1e-9 of it, so only three digits of their size would be known.
    constexpr double smallest_orbit = 1e-6;
    const VectorXd first = states.col(0);
    const VectorXd way = time * problem.system.rhs(first, std::vector<double>{0.0}, problem.theta);
    return relative_size(way, scale) < smallest_orbit &&
           relative_size(states.colwise() - first, scale) < smallest_orbit;
}

MatrixXd states_of(const Discretisation& discretisation, const MatrixXd& nodes, double time, Index n) {
    MatrixXd states(n, nodes.cols());
    for (Index j = 0; j < nodes.cols(); ++j)
        states.col(j) = discretisation.state(j, nodes.col(j), time, {}).value;
    return states;
}

std::optional<PhaseCondition> condition_at(const OrbitProblem& problem, const Discretisation& discretisation,
                                           const DiscreteStart& first) {
    const auto& [system, theta, start, free, options] = problem;
    const bool on_plane = !discretisation.unknown_time() || start.section || options.phase != PhaseChoice::integral;
    return phase_condition(
        system, theta, on_plane ? start.points : states_of(discretisation, first.nodes, first.time, system.dimension()),
        discretisation.shares(), start.section, options.phase);
}

/// Whether the orbit is the one that was looked for: its distance from the guess, and how often it repeats itself.
void compare_with_start(PeriodicOrbit& orbit, const OrbitProblem& problem, const MatrixXd& states,
                        const VectorXd& scale) {
    const auto& [system, theta, start, free, options] = problem;
    const std::vector<Index> angles = angle_coordinates(system);
    const Index compared = orbit.points.cols() == start.points.cols() ? start.points.cols() : 1;
    orbit.distance =
        relative_size(wrapped_angles(states.leftCols(compared) - start.points.leftCols(compared), angles), scale);
    orbit.repeats = repeats_of(orbit.points, angles, scale);
    if (problem.autonomous() && orbit.repeats == 1)
        orbit.repeats = repeats_in_time(system, theta, states.col(0), orbit.time, angles, scale, options.flow);
    if (orbit.repeats > 1) {
        orbit.status = OrbitStatus::shorter_period;
    } else if (!(orbit.distance <= options.maximum_distance)) {
        orbit.status = OrbitStatus::other_orbit;
    }
}

/// Everything of a solved orbit: at its last nodes, whose steps are followed once more with the free parameters, in
/// pieces where errors grow much.
/// @param near  Jacobians of the steps, but for the last correction.
void report(const OrbitProblem& problem, const DiscreteEquations& equations, const DiscreteStart& first,
            const VectorXd& scale, const std::vector<MatrixXd>& near, DiscreteSolution& solution) {
    const Discretisation& discretisation = equations.discretisation;
    PeriodicOrbit& orbit = solution.orbit;
    const ClosingError closing = closing_error(discretisation, solution.nodes, orbit.time, equations.turns,
                                               problem.free, discretisation.pieces(near));
    if (!closing.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return;
    }
    orbit.residual = closing.error.cwiseAbs().maxCoeff();
    orbit.sticking = closing.sticking;
    const std::vector<MatrixXd> factors = discretisation.propagators(closing.factors);
    orbit.multipliers = floquet_multipliers(condensed_factors(factors));
    const bool autonomous = discretisation.unknown_time();
    if (autonomous && !orbit.multipliers.empty()) orbit.trivial_multiplier = take_trivial(orbit.multipliers);
    MatrixXd sensitivities;
    if (!problem.free.empty()) {
        sensitivities = node_sensitivities(equations, closing, solution.nodes, orbit.time, problem.free);
        if (autonomous) orbit.time_sensitivities = orbit.time * sensitivities.bottomRows(1);
    }
    const OrbitPoints reported =
        points_at(problem, discretisation, solution.nodes, sensitivities, first.points, orbit.time);
    if (!reported.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return;
    }
    orbit.times = reported.times;
    orbit.sensitivities = reported.sensitivities;
    orbit.jacobians =
        merged_factors(factors.size() == closing.jacobians.size() ? factors : closing.jacobians, reported.nodes);
    orbit.points = wrapped_angles(reported.states, angle_coordinates(problem.system));
    compare_with_start(orbit, problem, reported.states, scale);
}

}  // namespace

DiscreteSolution solve_discrete(const OrbitProblem& problem, const Discretisation& discretisation,
                                const DiscreteStart& first) {
    const auto& [system, theta, start, free, options] = problem;
    const Index n = system.dimension();
    const Index copies = discretisation.dimension() / n;
    const bool autonomous = discretisation.unknown_time();
    const std::vector<Index> angles = angle_coordinates(system);
    const VectorXd scale = options.scale.size() > 0
                               ? options.scale
                               : default_scale(system, autonomous ? first.nodes.topRows(n) : start.points);

    DiscreteSolution solution{problem.unsolved(OrbitStatus::not_simulated), first.nodes};
    PeriodicOrbit& orbit = solution.orbit;
    orbit.time = first.time;
    if (at_equilibrium(problem, start.points, first.time, scale)) {
        orbit.status = OrbitStatus::equilibrium;
        orbit.points = start.points.col(0);
        return solution;
    }
    if (!first.closing.simulated) return solution;
    ClosingError closing = first.closing;
    const MatrixXd turns =
        winding_numbers(closing.error.bottomRows(n), angles, first.rotation.empty() ? start.rotation : first.rotation)
            .replicate(copies, 1);
    closing.error -= full_turn * turns;
    orbit.rotation = total_rotation(turns, angles);

    const std::optional<PhaseCondition> condition = condition_at(problem, discretisation, first);
    const VectorXd node_scale = scale.replicate(copies, 1);
    const DiscreteEquations equations{discretisation, turns, condition, node_scale};
    const NewtonResult found = newton(equations, first.nodes, first.time, std::move(closing), options);
    orbit.status = found.status;
    orbit.iterations = first.iterations + found.iterations;
    orbit.residual = found.residual;
    orbit.time = found.time;
    solution.nodes = found.nodes;
    if (autonomous) {
        const MatrixXd states = states_of(discretisation, solution.nodes, orbit.time, n);
        if (states.allFinite() && at_equilibrium(problem, states, orbit.time, scale)) {
            orbit.status = OrbitStatus::equilibrium;
            orbit.points = wrapped_angles(states.col(0), angles);
            return solution;
        }
        if (orbit.status != OrbitStatus::converged) orbit.points = wrapped_angles(states, angles);
    }
    if (orbit.status == OrbitStatus::converged)
        report(problem, equations, first, scale, found.closing.jacobians, solution);
    return solution;
}

}  // namespace orbid::periodic
