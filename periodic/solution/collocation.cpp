#include "periodic/solution/collocation.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
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

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void require_collocation(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("solve_collocation: " + message);
}

void check(const models::System& system, const CollocationOptions& options) {
    require_collocation(system.kind() != models::Kind::map, "a map has no time derivative; use multiple shooting");
    require_collocation(options.intervals >= 2, "intervals is " + std::to_string(options.intervals) + ", must be >= 2");
    require_collocation(options.mesh_updates >= 0, "mesh_updates must be >= 0");
    require_collocation(options.accuracy > 0.0, "accuracy must be > 0");
    require_collocation(options.halvings >= 0, "halvings must be >= 0");
}

/// A start that is solved on one mesh after the other.
class Refinement {
public:
    Refinement(const models::System& system, const VectorXd& theta, const StartingSolution& start,
               const FarStartSearch& near, const VectorXd& scale, const CollocationOptions& options)
        : system_(system),
          theta_(theta),
          start_(start),
          options_(options),
          field_(system, theta, start.phase, start.points.cols()),
          method_(gauss_method(options.stages)),
          rotation_(near.rotation),
          time_(near.mesh.time) {
        options_.solver.scale = scale;
        double share = 0.0;
        for (const Segment& segment : near.mesh.segments) {
            points_.push_back(share);
            share += segment.share;
        }
        if (system.kind() == models::Kind::autonomous && !start.section) points_ = {0.0};
    }

    /// Solves on a mesh, with the guess at its points. Later guesses come from the solution.
    PeriodicOrbit solve(const std::vector<double>& mesh, MatrixXd guess, std::span<const Index> free) {
        const GaussSteps steps(field_, method_, mesh);
        DiscreteStart first;
        first.nodes = std::move(guess);
        first.time = time_;
        first.points = points_;
        first.rotation = rotation_;
        first.closing =
            closing_error(steps, first.nodes, time_, MatrixXd::Zero(first.nodes.rows(), first.nodes.cols()));
        DiscreteSolution solution = solve_discrete(system_, theta_, start_, steps, first, free, options_.solver);
        if (solved(solution.orbit)) {
            time_ = solution.orbit.time;
            polynomial_ = piecewise_polynomial(steps, solution.nodes, time_);
        }
        return std::move(solution.orbit);
    }

    /// An orbit was found, whichever.
    [[nodiscard]] static bool solved(const PeriodicOrbit& orbit) {
        return orbit.status == OrbitStatus::converged || orbit.status == OrbitStatus::other_orbit ||
               orbit.status == OrbitStatus::shorter_period;
    }
    [[nodiscard]] bool can_move() const { return !polynomial_.slopes.empty(); }
    [[nodiscard]] std::vector<double> moved() const {
        return equidistributed(polynomial_, method_, options_.solver.scale);
    }
    [[nodiscard]] std::vector<double> finer() const { return halved(polynomial_.mesh); }
    [[nodiscard]] MatrixXd at(const std::vector<double>& mesh) const { return polynomial_.at(mesh, method_); }

private:
    const models::System& system_;
    const VectorXd& theta_;
    const StartingSolution& start_;
    CollocationOptions options_;
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
    check(system, options);
    validate(system, free, options.solver);
    const ShootingMesh course = mesh_from_guess(system, theta, start, options.solver.flow);
    require_collocation(system.smooth(theta),
                        std::string(system.name()) + " is not smooth at these parameters; use multiple shooting");
    PeriodicOrbit orbit;
    orbit.status = OrbitStatus::not_simulated;
    orbit.period = static_cast<int>(start.points.cols());
    if (!course.simulated) return orbit;
    const VectorXd scale = options.solver.scale.size() > 0 ? options.solver.scale : default_scale(system, start.points);
    const FarStartSearch near = improve_guess(system, theta, course, start, scale, options.solver);
    Refinement refinement(system, theta, start, near, scale, options);

    const Index intervals = options.intervals * start.points.cols();
    std::vector<double> mesh;
    for (Index j = 0; j < intervals; ++j)
        mesh.push_back(static_cast<double>(j) / static_cast<double>(intervals));
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
        if (!Refinement::solved(orbit) || !refinement.can_move()) return orbit;
        again(refinement.moved(), options.halvings == 0 && i + 1 == options.mesh_updates);
    }
    orbit.discretisation_error = std::numeric_limits<double>::quiet_NaN();
    const std::vector<Index> angles = angle_coordinates(system);
    // An error of order two is certain where a derivative of the equations jumps within intervals, the pendulum's v|v|.
    // Reductions seen there are erratic, and dividing by 4^m - 1 gave estimates 100 times too small.
    constexpr double reduction = 4.0;
    for (int i = 0; i < options.halvings; ++i) {
        if (!Refinement::solved(orbit) || !refinement.can_move()) return orbit;
        const MatrixXd coarse = orbit.points;
        const double coarse_time = orbit.time;
        again(refinement.finer(), true);
        if (!Refinement::solved(orbit)) return orbit;
        const double difference = std::max(relative_size(wrapped_angles(orbit.points - coarse, angles), scale),
                                           std::abs(orbit.time / coarse_time - 1.0));
        orbit.discretisation_error = difference / (reduction - 1.0);
        if (orbit.discretisation_error <= options.accuracy) break;
    }
    return orbit;
}

}  // namespace orbid::periodic
