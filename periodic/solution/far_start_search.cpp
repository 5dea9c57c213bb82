#include "periodic/solution/far_start_search.hpp"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/coarse_flow.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/guess_correction.hpp"
#include "periodic/solution/newton.hpp"
#include "periodic/solution/winding_choice.hpp"

namespace orbid::periodic {
namespace {

/// Newton's first step may lead to another orbit than the nearest in two cases. The second step, with the old matrix,
/// is not four times shorter. Or the first is this many times longer than a correction that leaves part of the closing
/// error, counted ten times (a direction that the equations hardly determine). Of 600 starts 3e-3 to 1e-2 from cycles
/// of both pendulums two went astray undetected by both. One in ten easy ones of the torque-driven pendulum (none of
/// the other's) is examined more closely than it needs.
constexpr double contracting = 0.25;
constexpr double needlessly_long = 1.5;
constexpr double weight_of_rest = 10.0;

/// Errors of the flow, and the closing error at which Newton's method stops with it: a hundred times larger, as errors
/// grow along segments. Of 10 600 starts 3e-3 and 1e-2 from cycles of both pendulums as many end at the right orbit
/// with flows to 1e-5, 1e-6 and 1e-7; those to 1e-5 take a step more afterwards.
constexpr double coarse_tolerance = 1e-6;
constexpr double coarsely_closed = 1e-4;

/// Root mean square move of the measured nodes and of ln T, in units of the scales.
double distance(const NewtonResult& found, const ShootingMesh& guess, const VectorXd& scale) {
    double sum = 0.0;
    for (const Index j : guess.points)
        sum += ((found.nodes.col(j) - guess.nodes.col(j)).array() / scale.array()).matrix().squaredNorm();
    return sum;
}

/// The mesh through the nodes that were found.
ShootingMesh moved(ShootingMesh mesh, const NewtonResult& found, bool autonomous) {
    mesh.nodes = found.nodes;
    if (!autonomous) return mesh;
    for (Segment& segment : mesh.segments)
        segment.duration = segment.duration * found.time / mesh.time;
    mesh.time = found.time;
    return mesh;
}

}  // namespace

FarStartSearch improve_guess(const OrbitProblem& problem, const ShootingMesh& mesh) {
    const models::System& system = problem.system;
    const StartingSolution& start = problem.start;
    const ShootingOptions& options = problem.options;
    const VectorXd scale = problem.scale();
    FarStartSearch result{mesh, false, {}, 0};
    if (!mesh.simulated) return result;
    ShootingOptions coarse = options;
    coarse.flow = coarsened(options.flow, coarse_tolerance);
    coarse.tolerance = std::max(options.tolerance, coarsely_closed);
    const FlowSteps steps(system, problem.theta, mesh, coarse.flow);
    const ClosingError first = closing_error(steps, mesh.nodes, mesh.time);
    if (!first.simulated) return result;
    const std::vector<Index> angles = angle_coordinates(system);
    const MatrixXd nearest = winding_numbers(first.error, angles, start.rotation);
    const MatrixXd likely = likely_turns(first, nearest, angles, scale, start.rotation);
    result.rotation = total_rotation(likely, angles);
    const auto condition =
        phase_condition(system, problem.theta, mesh.nodes, steps.shares(), start.section, options.phase);

    const auto taken_off = [&](const MatrixXd& turns) {
        ClosingError closing = first;
        closing.error -= full_turn * turns;
        return closing;
    };
    const auto newton_from = [&](const MatrixXd& turns, const MatrixXd& nodes, double time, ClosingError closing,
                                 int iterations) {
        coarse.maximum_iterations = iterations;
        return newton({steps, turns, condition, scale}, nodes, time, std::move(closing), coarse);
    };
    const auto solve_carefully = [&](const MatrixXd& turns) {
        CorrectedGuess corrected =
            corrected_guess({steps, turns, condition, scale}, mesh.nodes, mesh.time, taken_off(turns), mesh.points);
        if (!corrected.closed) return NewtonResult{};
        return newton_from(turns, corrected.nodes, corrected.time, std::move(corrected.closing),
                           options.maximum_iterations);
    };
    double best = std::numeric_limits<double>::infinity();
    const auto consider = [&](const NewtonResult& found, const MatrixXd& turns) {
        if (found.status != OrbitStatus::converged || !(distance(found, mesh, scale) < best)) return;
        best = distance(found, mesh, scale);
        result = {moved(mesh, found, problem.autonomous()), true, total_rotation(turns, angles), found.iterations};
    };
    // The first step tells whether Newton's method needs no help. A map has no coarse image, and is left to it then.
    NewtonResult direct = newton_from(likely, mesh.nodes, mesh.time, taken_off(likely), 1);
    const bool trusted =
        !options.nearest ||
        (direct.contraction < contracting &&
         direct.first_step <= needlessly_long * shortest_correction(taken_off(likely), scale, weight_of_rest));
    if (trusted && system.kind() == models::Kind::map) return result;
    const auto go_on = [&] {
        if (direct.status == OrbitStatus::iteration_limit) {
            direct =
                newton_from(likely, direct.nodes, direct.time, std::move(direct.closing), options.maximum_iterations);
            ++direct.iterations;
        }
        consider(direct, likely);
    };
    if (trusted) go_on();
    if (trusted && (result.closed || !options.nearest)) return result;
    consider(solve_carefully(likely), likely);
    if ((likely - nearest).cwiseAbs().maxCoeff() > 0.0) consider(solve_carefully(nearest), nearest);
    if (!trusted && !result.closed) go_on();
    return result;
}

}  // namespace orbid::periodic
