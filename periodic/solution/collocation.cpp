#include "periodic/solution/collocation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "periodic/discretisation/collocation_mesh.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/far_start_search.hpp"
#include "periodic/solution/orbit_solution.hpp"

namespace orbid::periodic {
namespace {

constexpr auto collocation_name = "solve_collocation";

void check(const CollocationOptions& options) {
    const auto require = [](bool holds, const std::string& message) {
        if (!holds) throw std::invalid_argument(std::string(collocation_name) + ": " + message);
    };
    require(options.intervals >= 2, "intervals is " + std::to_string(options.intervals) + ", must be >= 2");
    require(options.mesh_updates >= 0, "mesh_updates must be >= 0");
    require(options.accuracy > 0.0, "accuracy must be > 0");
    require(options.halvings >= 0, "halvings must be >= 0");
}

/// A start that is solved on one mesh after the other.
class Refinement {
public:
    /// @param problem  with the scale among its options.
    Refinement(const OrbitProblem& problem, const FarStartSearch& near, int stages)
        : problem_(problem),
          field_(problem.system, problem.theta, problem.start.phase, problem.start.points.cols()),
          method_(gauss_method(stages)),
          points_(problem.without_section() ? std::vector<double>{0.0} : near.mesh.begins()),
          rotation_(near.rotation),
          time_(near.mesh.time) {}

    /// Solves on a mesh, with the guess at its points. Later guesses come from the solution.
    PeriodicOrbit solve(const std::vector<double>& mesh, MatrixXd guess, std::span<const Index> free) {
        const GaussSteps steps(field_, method_, mesh);
        DiscreteStart first;
        first.nodes = std::move(guess);
        first.time = time_;
        first.points = points_;
        first.rotation = rotation_;
        first.closing = closing_error(steps, first.nodes, time_);
        DiscreteSolution solution =
            solve_discrete({problem_.system, problem_.theta, problem_.start, free, problem_.options}, steps, first);
        if (is_orbit(solution.orbit.status)) {
            time_ = solution.orbit.time;
            polynomial_ = piecewise_polynomial(steps, solution.nodes, time_);
        }
        return std::move(solution.orbit);
    }

    /// The solution can be looked at on another mesh.
    [[nodiscard]] bool can_move(const PeriodicOrbit& orbit) const {
        return is_orbit(orbit.status) && !polynomial_.slopes.empty();
    }
    [[nodiscard]] std::vector<double> moved() const {
        return equidistributed(polynomial_, method_, problem_.options.scale);
    }
    [[nodiscard]] std::vector<double> finer() const { return halved(polynomial_.mesh); }
    [[nodiscard]] MatrixXd at(const std::vector<double>& mesh) const { return polynomial_.at(mesh, method_); }

private:
    const OrbitProblem& problem_;
    OrbitField field_;
    GaussMethod method_;
    std::vector<double> points_;
    std::vector<int> rotation_;
    double time_;
    PiecewisePolynomial polynomial_;
};

}  // namespace

PeriodicOrbit solve_collocation(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                                std::span<const Index> free, const CollocationOptions& options) {
    require_flow(system, collocation_name);
    check(options);
    validate({system, theta, start, free, options.solver});
    const ShootingMesh course = mesh_from_guess(system, theta, start, options.solver.flow);
    ShootingOptions solver = options.solver;
    const OrbitProblem problem{system, theta, start, free, solver};
    require_smooth(problem, collocation_name);
    solver.scale = problem.scale();
    PeriodicOrbit orbit = problem.unsolved(OrbitStatus::not_simulated);
    if (!course.simulated) return orbit;
    const FarStartSearch near = improve_guess(problem, course);
    Refinement refinement(problem, near, options.stages);

    const std::vector<double> mesh = equidistant(options.intervals * start.points.cols());
    const SampledMesh guess = sampled(system, theta, near.mesh, mesh, options.solver.flow);
    if (!guess.simulated) return orbit;
    const bool single = options.mesh_updates == 0 && options.halvings == 0;
    orbit = refinement.solve(mesh, guess.states, single ? free : std::span<const Index>{});
    orbit.iterations += near.iterations;
    const auto again = [&](const std::vector<double>& next, bool last) {
        int iterations = orbit.iterations;
        orbit = refinement.solve(next, refinement.at(next), last ? free : std::span<const Index>{});
        orbit.iterations += iterations;
    };
    for (int i = 0; i < options.mesh_updates; ++i) {
        if (!refinement.can_move(orbit)) return orbit;
        again(refinement.moved(), options.halvings == 0 && i + 1 == options.mesh_updates);
    }
    orbit.discretisation_error = std::numeric_limits<double>::quiet_NaN();
    const std::vector<Index> angles = angle_coordinates(system);
    // An error of order two is certain where a derivative of the equations jumps within intervals, the pendulum's v|v|.
    // Reductions seen there are erratic, and dividing by 4^m - 1 gave estimates 100 times too small.
    constexpr double reduction = 4.0;
    for (int i = 0; i < options.halvings; ++i) {
        if (!refinement.can_move(orbit)) return orbit;
        const MatrixXd coarse = orbit.points;
        const double coarse_time = orbit.time;
        again(refinement.finer(), true);
        if (!is_orbit(orbit.status)) return orbit;
        const double difference = std::max(relative_size(wrapped_angles(orbit.points - coarse, angles), solver.scale),
                                           std::abs(orbit.time / coarse_time - 1.0));
        orbit.discretisation_error = difference / (reduction - 1.0);
        if (orbit.discretisation_error <= options.accuracy) break;
    }
    return orbit;
}

}  // namespace orbid::periodic
