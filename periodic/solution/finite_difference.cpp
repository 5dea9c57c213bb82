#include "periodic/solution/finite_difference.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "periodic/discretisation/difference_steps.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/far_start_search.hpp"
#include "periodic/solution/orbit_solution.hpp"

namespace orbid::periodic {
namespace {

/// Sequence without structure in [-1, 1]: the fractional parts of multiples of the golden ratio.
double scattered(int k) {
    return 2.0 * std::fmod(0.6180339887498949 * (k + 1), 1.0) - 1.0;
}

constexpr auto finite_difference_name = "solve_finite_difference";

/// @param problem  with the scale among its options.
PeriodicOrbit solve_on(Index steps, const OrbitProblem& problem, const FarStartSearch& near, bool second_order) {
    const auto& [system, theta, start, free, options] = problem;
    const Index n = system.dimension();
    const OrbitField field(system, theta, start.phase, start.points.cols());

    // At the nodes, and midway between them for the velocities of Fey's scheme.
    const SampledMesh guess = sampled(system, theta, near.mesh, equidistant(2 * steps), options.flow);
    if (!guess.simulated) return problem.unsolved(OrbitStatus::not_simulated);
    const VectorXd turns = full_turn * guess.turns;
    const auto at_half = [&](Index k) -> VectorXd {
        return k >= 0 ? VectorXd(guess.states.col(k)) : VectorXd(guess.states.col(k + 2 * steps) - turns);
    };

    DiscreteStart first;
    first.time = near.mesh.time;
    first.rotation = near.rotation;
    first.iterations = near.iterations;
    if (!problem.without_section()) first.points = near.mesh.begins();
    const SecondOrderStructure structure = second_order_structure(system, theta, guess.states, options.scale);
    std::unique_ptr<Discretisation> scheme;
    if (second_order && structure.complete) {
        scheme = std::make_unique<SecondOrderSteps>(field, steps, structure.velocity);
        first.nodes.resize(n, steps);
        for (Index k = 0; k < steps; ++k) {
            first.nodes.col(k) = at_half(2 * k);
            const VectorXd midway = at_half(2 * k - 1);
            for (const Index v : structure.velocity)
                if (v >= 0) first.nodes(v, k) = midway(v);
        }
    } else {
        scheme = std::make_unique<CentredSteps>(field, steps);
        first.nodes.resize(2 * n, steps);
        for (Index k = 0; k < steps; ++k)
            first.nodes.col(k) << at_half(2 * k - 2), at_half(2 * k);
    }
    first.closing = closing_error(*scheme, first.nodes, first.time);
    return solve_discrete(problem, *scheme, first).orbit;
}

}  // namespace

SecondOrderStructure second_order_structure(const models::System& system, const VectorXd& theta, const MatrixXd& states,
                                            const VectorXd& scale) {
    const Index n = system.dimension();
    SecondOrderStructure structure;
    structure.velocity.assign(static_cast<std::size_t>(n), -1);
    // Twenty states are enough: two different expressions agree in all bits at one of them by chance at most.
    constexpr int count = 20;
    MatrixXd probes(n, count);
    std::vector<double> phases;
    for (int k = 0; k < count; ++k) {
        probes.col(k) = states.col(k * (states.cols() - 1) / count);
        for (Index i = 0; i < n; ++i)
            probes(i, k) += 0.1 * scale(i) * scattered(static_cast<int>(n) * k + static_cast<int>(i));
        phases.push_back(3.0 * scattered(k));
    }
    const MatrixXd f = system.rhs(probes, phases, theta);
    std::vector<bool> taken(static_cast<std::size_t>(n), false);
    Index pairs = 0;
    for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < n; ++j)
            if (i != j && !taken[static_cast<std::size_t>(j)] && (f.row(i).array() == probes.row(j).array()).all()) {
                structure.velocity[static_cast<std::size_t>(i)] = j;
                taken[static_cast<std::size_t>(j)] = true;
                ++pairs;
                break;
            }
    structure.complete = 2 * pairs == n;
    for (Index i = 0; i < n; ++i)  // a velocity that is a position as well: a chain, not a second-order system
        if (structure.velocity[static_cast<std::size_t>(i)] >= 0 && taken[static_cast<std::size_t>(i)])
            structure.complete = false;
    return structure;
}

PeriodicOrbit solve_finite_difference(const models::System& system, const VectorXd& theta,
                                      const StartingSolution& start, std::span<const Index> free,
                                      const FiniteDifferenceOptions& options) {
    require_flow(system, finite_difference_name);
    if (!(options.nodes >= 5))
        throw std::invalid_argument(std::string(finite_difference_name) + ": nodes is " +
                                    std::to_string(options.nodes) + ", must be >= 5");
    ShootingOptions solver = options.solver;
    const OrbitProblem problem{system, theta, start, free, solver};
    validate(problem);
    const ShootingMesh mesh = mesh_from_guess(system, theta, start, solver.flow);
    require_smooth(problem, finite_difference_name);
    solver.scale = problem.scale();
    if (!mesh.simulated) return problem.unsolved(OrbitStatus::not_simulated);
    const FarStartSearch near = improve_guess(problem, mesh);
    const auto solve = [&](Index nodes, std::span<const Index> wanted) {
        Index steps = nodes * start.points.cols();
        const bool pairs = options.second_order &&
                           second_order_structure(system, theta, start.points.replicate(1, 30), solver.scale).complete;
        if (!pairs && steps % 2 == 0) ++steps;
        return solve_on(steps, {system, theta, start, wanted, solver}, near, options.second_order);
    };
    PeriodicOrbit orbit = solve(options.nodes, free);
    orbit.discretisation_error = std::numeric_limits<double>::quiet_NaN();
    if (!options.estimate_error || orbit.status != OrbitStatus::converged) return orbit;
    const PeriodicOrbit coarse = solve(std::max(5, options.nodes / 2), {});
    if (coarse.status != OrbitStatus::converged) return orbit;
    // With errors of c h^2 that of the finer one is a third of the difference.
    const std::vector<Index> angles = angle_coordinates(system);
    const MatrixXd difference = orbit.points.cols() == coarse.points.cols()
                                    ? MatrixXd(orbit.points - coarse.points)
                                    : MatrixXd(orbit.points.col(0) - coarse.points.col(0));
    orbit.discretisation_error = relative_size(wrapped_angles(difference, angles), solver.scale) / 3.0;
    return orbit;
}

}  // namespace orbid::periodic
