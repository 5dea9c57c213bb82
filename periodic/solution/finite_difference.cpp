#include "periodic/solution/finite_difference.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>

#include "periodic/discretisation/difference_steps.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/far_start_search.hpp"
#include "periodic/solution/orbit_solution.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Sequence without structure in [-1, 1]: the fractional parts of multiples of the golden ratio.
double scattered(int k) {
    return 2.0 * std::fmod(0.6180339887498949 * (k + 1), 1.0) - 1.0;
}

PeriodicOrbit solve_on(Index steps, const models::System& system, const VectorXd& theta, const StartingSolution& start,
                       const FarStartSearch& near, const VectorXd& scale, std::span<const Index> free,
                       const FiniteDifferenceOptions& options) {
    const ShootingMesh& mesh = near.mesh;
    PeriodicOrbit failed;
    failed.status = OrbitStatus::not_simulated;
    failed.period = static_cast<int>(start.points.cols());
    const Index n = system.dimension();
    const OrbitField field(system, theta, start.phase, start.points.cols());

    // At the nodes, and midway between them for the velocities of Fey's scheme.
    std::vector<double> shares;
    for (Index k = 0; k < 2 * steps; ++k)
        shares.push_back(static_cast<double>(k) / static_cast<double>(2 * steps));
    const SampledMesh guess = sampled(system, theta, mesh, shares, options.solver.flow);
    if (!guess.simulated) return failed;
    const VectorXd turns = 2.0 * std::numbers::pi * guess.turns;
    const auto at_half = [&](Index k) -> VectorXd {
        return k >= 0 ? VectorXd(guess.states.col(k)) : VectorXd(guess.states.col(k + 2 * steps) - turns);
    };

    DiscreteStart first;
    first.time = mesh.time;
    first.rotation = near.rotation;
    first.iterations = near.iterations;
    double share = 0.0;
    for (const Segment& segment : mesh.segments) {
        first.points.push_back(share);
        share += segment.share;
    }
    const SecondOrderStructure structure = second_order_structure(system, theta, guess.states, scale);
    std::unique_ptr<Discretisation> scheme;
    if (options.second_order && structure.complete) {
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
    if (system.kind() == models::Kind::autonomous && !start.section) first.points.clear();
    first.closing = closing_error(*scheme, first.nodes, first.time, MatrixXd::Zero(first.nodes.rows(), steps));
    ShootingOptions solver = options.solver;
    solver.scale = scale;
    return solve_discrete(system, theta, start, *scheme, first, free, solver).orbit;
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
    if (system.kind() == models::Kind::map)
        throw std::invalid_argument("solve_finite_difference: a map has no time derivative; use multiple shooting");
    if (!(options.nodes >= 5))
        throw std::invalid_argument("solve_finite_difference: nodes is " + std::to_string(options.nodes) +
                                    ", must be >= 5");
    validate(system, free, options.solver);
    const ShootingMesh mesh = mesh_from_guess(system, theta, start, options.solver.flow);
    if (!system.smooth(theta))
        throw std::invalid_argument("solve_finite_difference: " + std::string(system.name()) +
                                    " is not smooth at these parameters; use multiple shooting");
    PeriodicOrbit orbit;
    orbit.status = OrbitStatus::not_simulated;
    orbit.period = static_cast<int>(start.points.cols());
    if (!mesh.simulated) return orbit;
    const VectorXd scale = options.solver.scale.size() > 0 ? options.solver.scale : default_scale(system, start.points);
    const FarStartSearch near = improve_guess(system, theta, mesh, start, scale, options.solver);
    const auto solve = [&](Index nodes, std::span<const Index> wanted) {
        Index steps = nodes * start.points.cols();
        const bool pairs = options.second_order &&
                           second_order_structure(system, theta, start.points.replicate(1, 30), scale).complete;
        if (!pairs && steps % 2 == 0) ++steps;
        return solve_on(steps, system, theta, start, near, scale, wanted, options);
    };
    orbit = solve(options.nodes, free);
    orbit.discretisation_error = std::numeric_limits<double>::quiet_NaN();
    if (!options.estimate_error || orbit.status != OrbitStatus::converged) return orbit;
    const PeriodicOrbit coarse = solve(std::max(5, options.nodes / 2), {});
    if (coarse.status != OrbitStatus::converged) return orbit;
    // With errors of c h^2 that of the finer one is a third of the difference.
    const std::vector<Index> angles = angle_coordinates(system);
    const MatrixXd difference = orbit.points.cols() == coarse.points.cols()
                                    ? MatrixXd(orbit.points - coarse.points)
                                    : MatrixXd(orbit.points.col(0) - coarse.points.col(0));
    orbit.discretisation_error = relative_size(wrapped_angles(difference, angles), scale) / 3.0;
    return orbit;
}

}  // namespace orbid::periodic
