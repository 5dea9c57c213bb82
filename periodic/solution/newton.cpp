#include "periodic/solution/newton.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "periodic/discretisation/cyclic_system.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// Newton's error squares from step to step. A full step below this fraction of the scale that is not followed by one
/// at least ten times smaller is rounding and integration error; no further step can help.
constexpr double noise_level = 1e-7;

/// A step that makes the period this many times shorter is not trusted, only shortened: the linearisation does not
/// describe motions so much faster.
constexpr double most_shrinkage = 4.0;

/// An orbit this many times shorter than its guess is none: the period goes to zero where nothing else closes.
constexpr double vanished = 1e-3;

/// The phase condition, scaled to size one: gap, and its derivatives.
struct Gap {
    VectorXd value;       ///< shape (k), k = 1 where T is unknown
    MatrixXd by_nodes;    ///< shape (k, d m): of the first m nodes, one or all
    MatrixXd by_ln_time;  ///< shape (k, k)
    MatrixXd by_parameters;
};

Gap gap_at(const DiscreteEquations& equations, const MatrixXd& nodes, double time, std::span<const Index> free) {
    const auto& [discretisation, turns, condition, scale] = equations;
    Gap gap;
    const Index d = nodes.rows();
    const auto f = static_cast<Index>(free.size());
    if (!discretisation.unknown_time()) {
        gap.value.resize(0);
        gap.by_nodes.resize(0, d);
        gap.by_ln_time.resize(0, 0);
        gap.by_parameters.resize(0, f);
        return gap;
    }
    assert(condition.has_value());
    const Index n = condition->normals.rows(), count = condition->normals.cols();
    const double size = (condition->normals.array().colwise() * scale.head(n).array()).matrix().norm() /
                        std::max(scale.head(n).maxCoeff(), std::numeric_limits<double>::min());
    const MatrixXd normals = condition->normals / size;
    gap.value = VectorXd::Constant(1, condition->offset / size);
    gap.by_nodes.resize(1, d * count);
    gap.by_ln_time = MatrixXd::Zero(1, 1);
    gap.by_parameters = MatrixXd::Zero(1, f);
    for (Index j = 0; j < count; ++j) {
        const StepImage x = discretisation.state(j, nodes.col(j), time, free);
        const VectorXd normal = normals.col(j);
        gap.value(0) -= normal.dot(x.value);
        gap.by_nodes.middleCols(d * j, d) = normal.transpose() * x.by_state;
        gap.by_ln_time(0, 0) += normal.dot(x.by_ln_time);
        gap.by_parameters += normal.transpose() * x.by_parameters;
    }
    return gap;
}

/// A move of all nodes and of ln T.
struct Move {
    MatrixXd nodes;
    double ln_time = 0.0;

    [[nodiscard]] double size(const VectorXd& scale) const {
        return std::max(relative_size(nodes, scale), std::abs(ln_time));
    }
    [[nodiscard]] double norm(const VectorXd& scale) const {
        return std::hypot((nodes.array().colwise() / scale.array()).matrix().norm(), ln_time);
    }
};

/// The iteration's matrix, factorised.
CyclicSystem linearised(const ClosingError& closing, const Gap& gap, const VectorXd& scale) {
    return {closing.jacobians, {closing.by_ln_time, gap.by_nodes, gap.by_ln_time}, scale};
}

Move solved(const CyclicSystem& matrix, const MatrixXd& error, const VectorXd& gap) {
    VectorXd right(error.size() + gap.size());
    right << error.reshaped(), gap;
    const VectorXd solution = matrix.solve(right);
    return {solution.head(error.size()).reshaped(error.rows(), error.cols()),
            gap.size() > 0 ? solution(error.size()) : 0.0};
}

/// What is known at the nodes and the time that were reached.
struct Iterate {
    ClosingError closing;
    Gap gap;
    double damping = 1.0;
    bool after_full_step = false;
};

/// Takes the step, halved until the next one with the same matrix is shorter. @return converged where it was taken, or
/// why not.
OrbitStatus damped_step(const DiscreteEquations& equations, const CyclicSystem& matrix, const Move& step,
                        double minimum_damping, Iterate& now, NewtonResult& result) {
    const auto& [discretisation, turns, condition, scale] = equations;
    const double step_size = step.size(scale);
    const double step_norm = step.norm(scale);
    bool simulated_once = false;
    bool shrank = false;
    for (double length = now.damping; length >= minimum_damping; length *= 0.5) {
        const MatrixXd trial_nodes = result.nodes + length * step.nodes;
        const double trial_time = result.time * (1.0 + length * step.ln_time);
        if (discretisation.unknown_time() &&
            !(most_shrinkage * trial_time > result.time && trial_time < most_shrinkage * result.time)) {
            shrank = trial_time < result.time;
            continue;
        }
        ClosingError trial = closing_error(discretisation, trial_nodes, trial_time, turns);
        if (!trial.simulated) continue;
        simulated_once = true;
        Gap trial_gap = gap_at(equations, trial_nodes, trial_time, {});
        const Move simplified = solved(matrix, trial.error, trial_gap.value);
        if (result.iterations == 0 && length == 1.0) result.contraction = simplified.norm(scale) / step_norm;
        // Below the noise level the test would compare rounding errors: the step is taken unchanged.
        if (!(simplified.norm(scale) <= (1.0 - 0.5 * length) * step_norm) && !(step_size < noise_level)) continue;
        result.nodes = trial_nodes;
        result.time = trial_time;
        now = {std::move(trial), std::move(trial_gap), std::min(1.0, 2.0 * length), length == 1.0};
        return OrbitStatus::converged;
    }
    if (simulated_once) return OrbitStatus::no_progress;
    return shrank ? OrbitStatus::period_vanished : OrbitStatus::not_simulated;
}

}  // namespace

std::optional<PhaseCondition> phase_condition(const models::System& system, const VectorXd& theta,
                                              const MatrixXd& guess, std::span<const double> shares,
                                              const std::optional<models::Section>& section, PhaseChoice choice) {
    if (system.kind() != models::Kind::autonomous) return std::nullopt;
    if (section) return PhaseCondition{section->normal, section->offset};
    const Index used = choice == PhaseChoice::integral ? guess.cols() : 1;
    PhaseCondition condition;
    condition.normals =
        system.rhs(guess.leftCols(used), std::vector<double>(static_cast<std::size_t>(used), 0.0), theta);
    for (Index j = 0; used > 1 && j < used; ++j) {
        const auto at = static_cast<std::size_t>(j);
        const double before = j > 0 ? shares[at - 1] : shares[static_cast<std::size_t>(used - 1)] - 1.0;
        const double after = j + 1 < used ? shares[at + 1] : 1.0;
        condition.normals.col(j) *= 0.5 * (after - before);
    }
    condition.offset = condition.normals.cwiseProduct(guess.leftCols(used)).sum();
    return condition;
}

NewtonResult newton(const DiscreteEquations& equations, const MatrixXd& start, double time, ClosingError first,
                    const ShootingOptions& options) {
    const VectorXd& scale = equations.scale;
    NewtonResult result;
    result.nodes = start;
    result.time = time;
    if (!first.simulated) {
        result.status = OrbitStatus::not_simulated;
        return result;
    }
    Iterate now{std::move(first), gap_at(equations, start, time, {})};
    result.residual = now.closing.error.cwiseAbs().maxCoeff();
    result.status = OrbitStatus::iteration_limit;
    double last_size = std::numeric_limits<double>::infinity();
    for (result.iterations = 0; result.iterations < options.maximum_iterations; ++result.iterations) {
        const CyclicSystem matrix = linearised(now.closing, now.gap, scale);
        if (matrix.singular()) {
            result.status = OrbitStatus::singular;
            return result;
        }
        const Move step = solved(matrix, now.closing.error, now.gap.value);
        const double step_size = step.size(scale);
        const bool closed = relative_size(now.closing.error, scale) <= options.tolerance;
        const bool stagnates = now.after_full_step && last_size < noise_level && step_size > 0.1 * last_size;
        if ((closed && step_size <= options.tolerance) || stagnates) {
            // Squares the error once more; the caller evaluates the result there anyway.
            result.nodes += step.nodes;
            result.time *= std::exp(step.ln_time);
            result.closing = std::move(now.closing);
            result.status = OrbitStatus::converged;
            return result;
        }

        if (result.iterations == 0) result.first_step = step.norm(scale);
        const OrbitStatus step_status = damped_step(equations, matrix, step, options.minimum_damping, now, result);
        result.residual = now.closing.error.cwiseAbs().maxCoeff();
        if (step_status != OrbitStatus::converged) {
            result.status = step_status;
            return result;
        }
        if (equations.discretisation.unknown_time() && !(result.time > vanished * time)) {
            result.status = OrbitStatus::period_vanished;
            return result;
        }
        last_size = step_size;
    }
    result.closing = std::move(now.closing);
    return result;
}

MatrixXd node_sensitivities(const DiscreteEquations& equations, const ClosingError& closing, const MatrixXd& nodes,
                            double time, std::span<const Index> free) {
    const Gap gap = gap_at(equations, nodes, time, free);
    MatrixXd right(closing.parameters.rows() + gap.value.size(), closing.parameters.cols());
    right << closing.parameters, -gap.by_parameters;
    return linearised(closing, gap, equations.scale).solve(right);
}

}  // namespace orbid::periodic
