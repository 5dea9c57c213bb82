#include "periodic/solution/multiple_shooting.hpp"

#include <stdexcept>
#include <string>
#include <utility>

#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/solution/far_start_search.hpp"
#include "periodic/solution/orbit_solution.hpp"

namespace orbid::periodic {

namespace {

PeriodicOrbit solve_once(const OrbitProblem& problem) {
    const auto& [system, theta, start, free, options] = problem;
    validate(problem);
    ShootingMesh mesh = mesh_from_guess(system, theta, start, options.flow);
    // The integral phase condition is a sum over the nodes; with fewer it is not much of an integral.
    constexpr int integral_nodes = 12;
    if (problem.without_section() && options.phase == PhaseChoice::integral)
        mesh = split_uniformly(system, theta, mesh, integral_nodes, options.flow);
    DiscreteStart first;
    if (mesh.simulated) {
        if (!problem.without_section()) first.points = mesh.begins();
        FarStartSearch near = improve_guess(problem, mesh);
        mesh = std::move(near.mesh);
        first.rotation = std::move(near.rotation);
        first.iterations = near.iterations;
        first.closing = refine_and_close(system, theta, mesh, options);
    }
    first.nodes = mesh.nodes;
    first.time = mesh.time;
    return solve_discrete(problem, FlowSteps(system, theta, mesh, options.flow), first).orbit;
}

}  // namespace

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta,
                                      const StartingSolution& start, std::span<const Index> free,
                                      const ShootingOptions& options) {
    const OrbitProblem problem{system, theta, start, free, options};
    PeriodicOrbit orbit = solve_once(problem);
    const auto found_one = [](OrbitStatus status) { return is_orbit(status) || status == OrbitStatus::equilibrium; };
    if (problem.without_section() && options.phase == PhaseChoice::automatic && !found_one(orbit.status)) {
        // The plane across the flow through a bad guess need not be crossed by the orbit.
        ShootingOptions anywhere = options;
        anywhere.phase = PhaseChoice::integral;
        PeriodicOrbit shifted = solve_once({system, theta, start, free, anywhere});
        if (found_one(shifted.status)) orbit = std::move(shifted);
    }
    if (start.rotation.empty() || orbit.status == OrbitStatus::converged) return orbit;
    // Is there an orbit near the guess with another winding number than requested?
    StartingSolution any_rotation = start;
    any_rotation.rotation.clear();
    PeriodicOrbit turning = solve_once({system, theta, any_rotation, free, options});
    const bool found = turning.status == OrbitStatus::converged || turning.status == OrbitStatus::other_orbit;
    const bool nearer = orbit.status != OrbitStatus::other_orbit || turning.distance < orbit.distance;
    if (!found || !nearer || turning.rotation == start.rotation) return orbit;
    turning.status = OrbitStatus::other_orbit;
    return turning;
}

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta, double phase,
                                      const MatrixXd& guess, std::span<const int> rotation, std::span<const Index> free,
                                      const ShootingOptions& options) {
    if (system.kind() == models::Kind::autonomous)
        throw std::invalid_argument("solve_multiple_shooting: the model must be forced or a map; " +
                                    std::string(system.name()) + " is autonomous");
    StartingSolution start;
    start.points = guess;
    start.rotation.assign(rotation.begin(), rotation.end());
    start.phase = phase;
    return solve_multiple_shooting(system, theta, start, free, options);
}

}  // namespace orbid::periodic
