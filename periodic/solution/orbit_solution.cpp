#include "periodic/solution/orbit_solution.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/equilibrium.hpp"
#include "periodic/solution/orbit_report.hpp"
#include "periodic/stability/floquet.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

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

MatrixXd states_of(const Discretisation& discretisation, const MatrixXd& nodes, double time, Index n) {
    MatrixXd states(n, nodes.cols());
    for (Index j = 0; j < nodes.cols(); ++j)
        states.col(j) = discretisation.state(j, nodes.col(j), time, {}).value;
    return states;
}

std::optional<PhaseCondition> condition_at(const models::System& system, const VectorXd& theta,
                                           const StartingSolution& start, const Discretisation& discretisation,
                                           const DiscreteStart& first, PhaseChoice choice) {
    VectorXd shares(discretisation.steps());
    for (Index j = 0; j < shares.size(); ++j)
        shares(j) = discretisation.share(j);
    const bool on_plane = !discretisation.unknown_time() || start.section || choice != PhaseChoice::integral;
    return phase_condition(
        system, theta, on_plane ? start.points : states_of(discretisation, first.nodes, first.time, system.dimension()),
        shares, start.section, choice);
}

/// Whether the orbit is the one that was looked for: its distance from the guess, and how often it repeats itself.
void compare_with_start(PeriodicOrbit& orbit, const models::System& system, const VectorXd& theta,
                        const MatrixXd& guess, const MatrixXd& states, const VectorXd& scale,
                        const ShootingOptions& options) {
    const std::vector<Index> angles = angle_coordinates(system);
    const Index compared = orbit.points.cols() == guess.cols() ? guess.cols() : 1;
    orbit.distance = relative_size(wrapped_angles(states.leftCols(compared) - guess.leftCols(compared), angles), scale);
    orbit.repeats = repeats_of(orbit.points, angles, scale);
    if (system.kind() == models::Kind::autonomous && orbit.repeats == 1)
        orbit.repeats = repeats_in_time(system, theta, states.col(0), orbit.time, angles, scale, options.flow);
    if (orbit.repeats > 1) {
        orbit.status = OrbitStatus::shorter_period;
    } else if (!(orbit.distance <= options.maximum_distance)) {
        orbit.status = OrbitStatus::other_orbit;
    }
}

void require_orbit(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("periodic orbit: " + message);
}

}  // namespace

void validate(const models::System& system, std::span<const Index> free, const ShootingOptions& options) {
    const auto parameters = static_cast<Index>(system.parameters().size());
    for (const Index index : free)
        require_orbit(index >= 0 && index < parameters,
                      "free parameter " + std::to_string(index) + " is not in [0, " + std::to_string(parameters) + ")");
    require_orbit(options.tolerance > 0.0, "tolerance must be > 0");
    require_orbit(options.maximum_iterations > 0, "maximum_iterations must be > 0");
    require_orbit(options.minimum_damping > 0.0 && options.minimum_damping < 1.0, "minimum_damping must lie in (0, 1)");
    require_orbit(options.maximum_distance > 0.0, "maximum_distance must be > 0");
    require_orbit(options.segment_growth > 1.0, "segment_growth must be > 1");
    require_orbit(options.scale.size() == 0 || (options.scale.size() == system.dimension() &&
                                                options.scale.allFinite() && options.scale.minCoeff() > 0.0),
                  "scale must be empty or hold one finite value > 0 per coordinate");
}

DiscreteSolution solve_discrete(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                                const Discretisation& discretisation, const DiscreteStart& first,
                                std::span<const Index> free, const ShootingOptions& options) {
    const Index n = system.dimension();
    const Index copies = discretisation.dimension() / n;
    const bool autonomous = discretisation.unknown_time();
    const std::vector<Index> angles = angle_coordinates(system);
    const VectorXd scale = options.scale.size() > 0
                               ? options.scale
                               : default_scale(system, autonomous ? first.nodes.topRows(n) : start.points);
    const VectorXd node_scale = scale.replicate(copies, 1);

    DiscreteSolution solution;
    PeriodicOrbit& orbit = solution.orbit;
    orbit.period = static_cast<int>(start.points.cols());
    orbit.time = first.time;
    solution.nodes = first.nodes;
    if (at_equilibrium(system, theta, start.points, first.time, scale)) {
        orbit.status = OrbitStatus::equilibrium;
        orbit.points = start.points.col(0);
        return solution;
    }
    if (!first.closing.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return solution;
    }
    ClosingError closing = first.closing;
    const MatrixXd turns =
        winding_numbers(closing.error.bottomRows(n), angles, first.rotation.empty() ? start.rotation : first.rotation)
            .replicate(copies, 1);
    closing.error -= full_turn * turns;
    orbit.rotation = total_rotation(turns, angles);

    const std::optional<PhaseCondition> condition =
        condition_at(system, theta, start, discretisation, first, options.phase);
    const NewtonResult newton_result =
        newton(discretisation, first.nodes, first.time, std::move(closing), turns, condition, node_scale, options);
    orbit.status = newton_result.status;
    orbit.iterations = first.iterations + newton_result.iterations;
    orbit.residual = newton_result.residual;
    orbit.time = newton_result.time;
    solution.nodes = newton_result.nodes;
    if (autonomous) {
        const MatrixXd states = states_of(discretisation, solution.nodes, orbit.time, n);
        if (states.allFinite() && at_equilibrium(system, theta, states, orbit.time, scale)) {
            orbit.status = OrbitStatus::equilibrium;
            orbit.points = wrapped_angles(states.col(0), angles);
            return solution;
        }
        if (orbit.status != OrbitStatus::converged) orbit.points = wrapped_angles(states, angles);
    }
    if (orbit.status != OrbitStatus::converged) return solution;

    closing = closing_error(discretisation, solution.nodes, orbit.time, turns, free);
    if (!closing.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return solution;
    }
    orbit.residual = closing.error.cwiseAbs().maxCoeff();
    orbit.sticking = closing.sticking;
    const std::vector<MatrixXd> factors = discretisation.propagators(closing.jacobians, solution.nodes, orbit.time);
    orbit.multipliers = floquet_multipliers(condensed_factors(factors));
    if (autonomous && !orbit.multipliers.empty()) orbit.trivial_multiplier = take_trivial(orbit.multipliers);
    MatrixXd sensitivities;
    if (!free.empty()) {
        sensitivities =
            node_sensitivities(discretisation, closing, solution.nodes, orbit.time, condition, node_scale, free);
        if (autonomous) orbit.time_sensitivities = orbit.time * sensitivities.bottomRows(1);
    }
    const OrbitPoints reported = points_at(system, theta, start, discretisation, solution.nodes, sensitivities,
                                           first.points, orbit.time, free, options.flow);
    if (!reported.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return solution;
    }
    orbit.times = reported.times;
    orbit.sensitivities = reported.sensitivities;
    orbit.jacobians =
        merged_factors(factors.size() == closing.jacobians.size() ? factors : closing.jacobians, reported.nodes);
    orbit.points = wrapped_angles(reported.states, angles);
    compare_with_start(orbit, system, theta, start.points, reported.states, scale, options);
    return solution;
}

}  // namespace orbid::periodic
