#include "periodic/multiple_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>

#include <tbb/parallel_for.h>

#include "periodic/cyclic_system.hpp"
#include "periodic/floquet.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double full_turn = 2.0 * std::numbers::pi;

/// Newton's error squares from step to step: a full step below this share of the scale that is not followed by one at
/// least ten times smaller consists of rounding and integration error, and no further step can help.
constexpr double noise_level = 1e-7;

/// Points closer than this share of the scale are the same point of an orbit. Two distinct points of a converged orbit
/// are closer only next to a period doubling, where the orbits cannot be told apart to this accuracy either.
constexpr double same_point = 1e-7;

/// The closing errors Phi(x_j) - x_{j+1} - 2 pi turns_j of all nodes, and their derivatives.
struct Closing {
    bool simulated = false;
    bool sticking = false;
    MatrixXd error;                   ///< shape (n, p)
    std::vector<MatrixXd> jacobians;  ///< X_j
    MatrixXd parameters;              ///< shape (n p, f): Y_j below each other
};

class Shooting {
public:
    Shooting(const models::System& system, const VectorXd& theta, double phase, const models::FlowOptions& flow)
        : system_(system),
          theta_(theta),
          phase_(phase),
          flow_(flow),
          clock_(system.kind() == models::Kind::forced ? models::Clock::phase : models::Clock::time),
          duration_(system.kind() == models::Kind::forced ? system.period(theta, clock_) : 1.0) {}

    [[nodiscard]] Closing closing(const MatrixXd& nodes, const MatrixXd& turns,
                                  std::span<const Index> free = {}) const {
        const Index n = nodes.rows();
        const Index p = nodes.cols();
        const auto f = static_cast<Index>(free.size());
        Closing result;
        result.error.resize(n, p);
        result.jacobians.resize(static_cast<std::size_t>(p));
        result.parameters.resize(n * p, f);
        std::vector<unsigned char> failed(static_cast<std::size_t>(p), 0);
        std::vector<unsigned char> stuck(static_cast<std::size_t>(p), 0);
        tbb::parallel_for(Index{0}, p, [&](Index j) {
            const auto slot = static_cast<std::size_t>(j);
            const double duration[] = {duration_};
            const models::FlowResult flow =
                system_.flow_with_sensitivities(nodes.col(j), phase_, duration, theta_, free, clock_, flow_);
            if (flow.status != models::FlowStatus::ok || !flow.states.allFinite() || !flow.sensitivities.allFinite()) {
                failed[slot] = 1;
                return;
            }
            result.error.col(j) = flow.states.col(0) - nodes.col((j + 1) % p) - full_turn * turns.col(j);
            result.jacobians[slot] = flow.sensitivities.leftCols(n);
            result.parameters.middleRows(n * j, n) = flow.sensitivities.rightCols(f);
            stuck[slot] = flow.stickings > 0 ? 1 : 0;
        });
        result.simulated = std::count(failed.begin(), failed.end(), 1) == 0;
        result.sticking = std::count(stuck.begin(), stuck.end(), 1) > 0;
        return result;
    }

private:
    const models::System& system_;
    const VectorXd& theta_;
    double phase_;
    models::FlowOptions flow_;
    models::Clock clock_;
    double duration_;
};

VectorXd as_vector(const MatrixXd& nodes) {
    return nodes.reshaped();
}

/// Largest element relative to the scale of its coordinate.
double size_of(const MatrixXd& step, const VectorXd& scale) {
    return (step.array().colwise() / scale.array()).abs().maxCoeff();
}

double norm_of(const MatrixXd& step, const VectorXd& scale) {
    return (step.array().colwise() / scale.array()).matrix().norm();
}

std::vector<Index> angle_coordinates(const models::System& system) {
    std::vector<Index> angles;
    for (Index i = 0; i < system.dimension(); ++i)
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) angles.push_back(i);
    return angles;
}

VectorXd default_scale(const models::System& system, const MatrixXd& guess) {
    VectorXd scale = guess.cwiseAbs().rowwise().maxCoeff();
    for (Index i = 0; i < scale.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) {
            scale(i) = full_turn;
        } else if (!(scale(i) > 0.0)) {
            scale(i) = 1.0;
        }
    }
    return scale;
}

void require(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("solve_multiple_shooting: " + message);
}

void validate(const models::System& system, const VectorXd& theta, double phase, const MatrixXd& guess,
              std::span<const int> rotation, std::span<const Index> free, const ShootingOptions& options) {
    require(system.kind() == models::Kind::forced || system.kind() == models::Kind::map,
            "the model must be forced or a map; " + std::string(system.name()) + " is autonomous");
    const auto parameters = static_cast<Index>(system.parameters().size());
    require(theta.size() == parameters, "theta has " + std::to_string(theta.size()) + " values, the model has " +
                                            std::to_string(parameters) + " parameters");
    require(theta.allFinite(), "theta must be finite");
    require(std::isfinite(phase), "phase must be finite");
    require(guess.rows() == system.dimension() && guess.cols() >= 1,
            "guess has shape (" + std::to_string(guess.rows()) + ", " + std::to_string(guess.cols()) +
                "), needed is (" + std::to_string(system.dimension()) + ", p) with p >= 1");
    require(guess.allFinite(), "guess must be finite");
    require(rotation.empty() || rotation.size() == angle_coordinates(system).size(),
            "rotation has " + std::to_string(rotation.size()) + " numbers, the model has " +
                std::to_string(angle_coordinates(system).size()) + " angles");
    for (const Index index : free)
        require(index >= 0 && index < parameters,
                "free parameter " + std::to_string(index) + " is not in [0, " + std::to_string(parameters) + ")");
    require(options.tolerance > 0.0, "tolerance must be > 0");
    require(options.maximum_iterations > 0, "maximum_iterations must be > 0");
    require(options.minimum_damping > 0.0 && options.minimum_damping < 1.0, "minimum_damping must lie in (0, 1)");
    require(options.maximum_distance > 0.0, "maximum_distance must be > 0");
    require(options.scale.size() == 0 ||
                (options.scale.size() == guess.rows() && options.scale.allFinite() && options.scale.minCoeff() > 0.0),
            "scale must be empty or hold one finite value > 0 per coordinate");
}

/// Whole turns from each node to the next: the nearest ones for the flow of the guess. Where the wanted total differs,
/// the segments whose nearest turn was the least certain give way, one turn each.
MatrixXd whole_turns(const MatrixXd& closing_error, const std::vector<Index>& angles, std::span<const int> rotation) {
    MatrixXd turns = MatrixXd::Zero(closing_error.rows(), closing_error.cols());
    for (std::size_t a = 0; a < angles.size(); ++a) {
        const Index i = angles[a];
        turns.row(i) = (closing_error.row(i) / full_turn).array().round();
        if (rotation.empty()) continue;
        double missing = rotation[a] - turns.row(i).sum();
        while (missing != 0.0) {
            const double direction = missing > 0.0 ? 1.0 : -1.0;
            Index least_certain = 0;
            (direction * (closing_error.row(i) / full_turn - turns.row(i))).maxCoeff(&least_certain);
            turns(i, least_certain) += direction;
            missing -= direction;
        }
    }
    return turns;
}

bool repeats_earlier(const MatrixXd& nodes, const std::vector<Index>& angles, const VectorXd& scale) {
    const Index p = nodes.cols();
    for (Index d = 1; d < p; ++d) {
        if (p % d != 0) continue;
        MatrixXd difference(nodes.rows(), p);
        for (Index j = 0; j < p; ++j)
            difference.col(j) = nodes.col((j + d) % p) - nodes.col(j);
        for (const Index i : angles)
            for (Index j = 0; j < p; ++j)
                difference(i, j) = models::wrapped(difference(i, j));
        if (size_of(difference, scale) < same_point) return true;
    }
    return false;
}

}  // namespace

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta, double phase,
                                      const MatrixXd& guess, std::span<const int> rotation, std::span<const Index> free,
                                      const ShootingOptions& options) {
    validate(system, theta, phase, guess, rotation, free, options);
    const Index n = guess.rows();
    const Index p = guess.cols();
    const std::vector<Index> angles = angle_coordinates(system);
    const VectorXd scale = options.scale.size() > 0 ? options.scale : default_scale(system, guess);
    const Shooting shooting(system, theta, phase, options.flow);

    PeriodicOrbit orbit;
    orbit.period = static_cast<int>(p);
    MatrixXd nodes = guess;
    Closing now = shooting.closing(nodes, MatrixXd::Zero(n, p));
    if (!now.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return orbit;
    }
    const MatrixXd turns = whole_turns(now.error, angles, rotation);
    now.error -= full_turn * turns;
    for (const Index i : angles)
        orbit.rotation.push_back(static_cast<int>(std::lround(turns.row(i).sum())));

    // Damped Newton with the natural monotonicity test (Deuflhard, Newton Methods for Nonlinear Problems, 2004, ch. 3):
    // a step is good when the next one, with the old matrix, is shorter. Invariant to how the rows are scaled, which a
    // test on the closing error is not: that grows by the multipliers.
    orbit.status = OrbitStatus::iteration_limit;
    double damping = 1.0;
    double last_size = std::numeric_limits<double>::infinity();
    bool last_was_full = false;
    orbit.residual = now.error.cwiseAbs().maxCoeff();
    for (orbit.iterations = 0; orbit.iterations < options.maximum_iterations; ++orbit.iterations) {
        const CyclicSystem matrix(now.jacobians);
        if (matrix.singular()) {
            orbit.status = OrbitStatus::singular;
            return orbit;
        }
        const MatrixXd step = matrix.solve(as_vector(now.error)).reshaped(n, p);
        const double step_size = size_of(step, scale);
        const bool closed = size_of(now.error, scale) <= options.tolerance;
        const bool stagnates = last_was_full && last_size < noise_level && step_size > 0.1 * last_size;
        if ((closed && step_size <= options.tolerance) || stagnates) {
            orbit.status = OrbitStatus::converged;
            nodes += step;  // squares the error once more; the last evaluation below is made anyway
            break;
        }

        const double step_norm = norm_of(step, scale);
        bool accepted = false;
        bool simulated_once = false;
        for (double length = damping; length >= options.minimum_damping; length *= 0.5) {
            const MatrixXd trial_nodes = nodes + length * step;
            Closing trial = shooting.closing(trial_nodes, turns);
            if (!trial.simulated) continue;
            simulated_once = true;
            const MatrixXd simplified = matrix.solve(as_vector(trial.error)).reshaped(n, p);
            // Below the noise level the test would compare rounding errors: the step is taken as it is.
            if (!(norm_of(simplified, scale) <= (1.0 - 0.5 * length) * step_norm) && !(step_size < noise_level))
                continue;
            nodes = trial_nodes;
            now = std::move(trial);
            last_was_full = length == 1.0;
            damping = std::min(1.0, 2.0 * length);
            accepted = true;
            break;
        }
        if (!accepted) {
            orbit.status = simulated_once ? OrbitStatus::no_progress : OrbitStatus::not_simulated;
            return orbit;
        }
        last_size = step_size;
    }
    orbit.residual = now.error.cwiseAbs().maxCoeff();
    if (orbit.status != OrbitStatus::converged) return orbit;

    now = shooting.closing(nodes, turns, free);
    if (!now.simulated) {
        orbit.status = OrbitStatus::not_simulated;
        return orbit;
    }
    orbit.residual = now.error.cwiseAbs().maxCoeff();
    orbit.sticking = now.sticking;
    orbit.distance = size_of(nodes - guess, scale);
    orbit.points = nodes;
    for (const Index i : angles)
        for (Index j = 0; j < p; ++j)
            orbit.points(i, j) = models::wrapped(nodes(i, j));
    orbit.multipliers = floquet_multipliers(now.jacobians);
    if (!free.empty()) orbit.sensitivities = CyclicSystem(now.jacobians).solve(now.parameters);
    orbit.jacobians = std::move(now.jacobians);
    if (repeats_earlier(nodes, angles, scale)) {
        orbit.status = OrbitStatus::shorter_period;
    } else if (!(orbit.distance <= options.maximum_distance)) {
        orbit.status = OrbitStatus::other_orbit;
    }
    return orbit;
}

}  // namespace orbid::periodic
