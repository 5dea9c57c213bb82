#include "periodic/solution/multiple_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/discretisation/discretisation.hpp"
#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/far_start_search.hpp"
#include "periodic/solution/orbit_solution.hpp"

namespace orbid::periodic {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

PeriodicOrbit solve_once(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                         std::span<const Index> free, const ShootingOptions& options) {
    validate(system, free, options);
    ShootingMesh mesh = mesh_from_guess(system, theta, start, options.flow);
    // The integral phase condition is a sum over the nodes; with fewer it is not much of an integral.
    constexpr int integral_nodes = 12;
    if (system.kind() == models::Kind::autonomous && !start.section && options.phase == PhaseChoice::integral)
        mesh = split_uniformly(system, theta, mesh, integral_nodes, options.flow);
    DiscreteStart first;
    if (mesh.simulated) {
        double share = 0.0;
        for (const Segment& segment : mesh.segments) {
            first.points.push_back(share);
            share += segment.share;
        }
        const VectorXd scale = options.scale.size() > 0 ? options.scale : default_scale(system, start.points);
        const FarStartSearch near = improve_guess(system, theta, mesh, start, scale, options);
        mesh = near.mesh;
        first.rotation = near.rotation;
        first.iterations = near.iterations;
        const auto close = [&] {
            return closing_error(FlowSteps(system, theta, mesh, options.flow), mesh.nodes, mesh.time,
                                 MatrixXd::Zero(mesh.nodes.rows(), mesh.nodes.cols()));
        };
        first.closing = close();
        const bool grows = first.closing.simulated &&
                           std::any_of(first.closing.jacobians.begin(), first.closing.jacobians.end(),
                                       [&](const MatrixXd& x) { return grows_beyond(x, options.segment_growth); });
        if (grows && system.kind() != models::Kind::map) {
            mesh = refined(system, theta, mesh, options.segment_growth, options.flow);
            first.closing = close();
        }
        if (system.kind() == models::Kind::autonomous && !start.section) first.points.clear();
    }
    first.nodes = mesh.nodes;
    first.time = mesh.time;
    return solve_discrete(system, theta, start, FlowSteps(system, theta, mesh, options.flow), first, free, options)
        .orbit;
}

}  // namespace

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta,
                                      const StartingSolution& start, std::span<const Index> free,
                                      const ShootingOptions& options) {
    PeriodicOrbit orbit = solve_once(system, theta, start, free, options);
    const auto found_one = [](OrbitStatus status) {
        return status == OrbitStatus::converged || status == OrbitStatus::other_orbit ||
               status == OrbitStatus::shorter_period || status == OrbitStatus::equilibrium;
    };
    if (system.kind() == models::Kind::autonomous && !start.section && options.phase == PhaseChoice::automatic &&
        !found_one(orbit.status)) {
        // The plane across the flow through a bad guess need not be crossed by the orbit.
        ShootingOptions anywhere = options;
        anywhere.phase = PhaseChoice::integral;
        PeriodicOrbit shifted = solve_once(system, theta, start, free, anywhere);
        if (found_one(shifted.status)) orbit = std::move(shifted);
    }
    if (start.rotation.empty() || orbit.status == OrbitStatus::converged) return orbit;
    // Is there an orbit near the guess with another winding number than requested?
    StartingSolution any_rotation = start;
    any_rotation.rotation.clear();
    PeriodicOrbit turning = solve_once(system, theta, any_rotation, free, options);
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
