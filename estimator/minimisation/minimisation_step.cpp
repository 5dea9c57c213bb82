#include <cmath>

#include "estimator/interface/not_finite.hpp"
#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

namespace {

/// Steps shorter than this, in posterior sds, are judged by gradients. Computed orbits carry rounding of up to 1e-6 sds
/// of their targets. That hides the 5e-7 that a step of 1e-3 gains, and is a fiftieth of the 5e-5 of a step of 1e-2.
constexpr double tiny_sds = 1e-2;

}  // namespace

/// Lists the blocks that the rule holds for as stopped, unless it holds for half of a residual's blocks or more. In
/// that case no block stands out, and the step has to be shortened.
bool Minimisation::stopped_blocks(const std::function<bool(std::size_t)>& rule) {
    std::vector<std::size_t> active(problem_.residuals.size(), 0);
    std::vector<std::size_t> lost(problem_.residuals.size(), 0);
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        ++active[set_.blocks[b].residual];
        if (!rule(b)) continue;
        ++lost[set_.blocks[b].residual];
        minimum_.stopped.push_back(b);
    }
    for (std::size_t r = 0; r < active.size(); ++r)
        if (lost[r] > 0 && 2 * lost[r] >= active[r]) minimum_.stopped.clear();
    if (minimum_.stopped.empty()) return false;
    minimum_.outcome = Outcome::blocks_stopped;
    return true;
}

bool Minimisation::try_step(const TrialStep& step) {
    State trial = state_;
    for (Eigen::Index i = 0; i < trial.u.size(); ++i) {
        const auto index = static_cast<std::size_t>(i);
        trial.u[i] = std::clamp(state_.u[i] + step.parameters.d[i], lower_[i], upper_[i]);
        if (step.parameters.active[index] < 0) trial.u[i] = lower_[i];
        if (step.parameters.active[index] > 0) trial.u[i] = upper_[i];
        trial.theta[i] = std::clamp(problem_.coordinates[index].natural(trial.u[i]), problem_.parameters[index].lower,
                                    problem_.parameters[index].upper);
    }
    for (std::size_t b = 0; b < set_.blocks.size(); ++b)
        trial.latents[set_.blocks[b].residual][set_.blocks[b].block] += step.latents[b];

    ++ledger_.trials;
    const double before = objective();
    StepRecord record{ledger_.round, "theta", false, before, before, step.mu, "", set_.provisional};
    const PriorModel prior = prior_at(problem_, trial.u);
    double alpha = 0.25;  // share of the step to keep after a rejection
    double change = infinity;
    double true_curvature = -1.0;
    Evaluation evaluation;
    std::vector<BlockRows> rows;
    if (std::isfinite(prior.value)) {
        evaluation =
            evaluate(problem_.residuals, set_, problem_.laws, trial.theta, trial.latents, derivatives_at_trial_);
        ++ledger_.evaluations;
        if (!evaluation.failed.empty()) {
            for (const std::size_t b : evaluation.failed)
                cut_[b] = true;
            record.reason = "block failed";
        } else {
            change = prior.value - minimum_.prior.value;
            change += value_change(set_, problem_.laws, state_.psi, minimum_.evaluation.values, evaluation.values);
            if (set_.constraints > 0)
                change += violation_change(set_, minimum_.evaluation.values, evaluation.values) /
                          (minimum_.matching * minimum_.matching);
            record.after = before + change;
            true_curvature = 2.0 * (change - step.slope);
            // Tiny steps: the gradients at both ends keep what the difference of two objectives loses to rounding.
            if (derivatives_at_trial_ && step.curvature < tiny_sds * tiny_sds) {
                rows = linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, trial.theta);
                const BlockArrow arrow =
                    standard_arrow(rows, problem_.laws, state_.psi, minimum_.matching, curvature(), false, false).arrow;
                const double slope =
                    model_change(arrow, step.parameters.d, step.latents).linear + prior.gradient.dot(step.parameters.d);
                change = 0.5 * (step.slope + slope);
                true_curvature = slope - step.slope;
                record.after = before + std::min(change, 0.0);
            }
            // Step length of the parabola through both values and the first slope.
            if (change > 0.0) alpha = std::clamp(-0.5 * step.slope / (change - step.slope), 0.1, 0.5);
        }
    }
    const double predicted = step.predicted_decrease();
    gain_ = predicted > 0.0 ? -change / predicted : -infinity;
    // A ten-thousandth of the predicted decrease is the usual least gain that still proves convergence.
    if (change < 0.0 && gain_ > 1e-4) {
        record.accepted = true;
        if (!derivatives_at_trial_) {
            evaluation = evaluate(problem_.residuals, set_, problem_.laws, trial.theta, trial.latents, true);
            ++ledger_.evaluations;
            if (!evaluation.failed.empty()) {
                record.accepted = false;
                record.reason = "block failed";
            }
        }
    } else if (record.reason.empty()) {
        record.reason = "no decrease";
    }
    if (!record.accepted) {
        record.after = before;
        ledger_.history.push_back(record);
        radius_ = alpha * std::min(radius_, step.length);
        derivatives_at_trial_ = false;
        return false;
    }
    // Near the minimum Gauss-Newton steps keep their direction and are too long or too short by the same factor each
    // time (Hartley's interpolation, applied to the next step).
    stretch_ = last_step_full_ && gain_ > 0.3 && true_curvature > 0.0
                   ? std::clamp(step.curvature / true_curvature, 0.4, 2.5)
                   : 1.0;
    ledger_.history.push_back(record);
    ++ledger_.iterations;
    last_objective_ = misfit();
    last_decrease_ = -change;
    ++accepted_;
    state_ = std::move(trial);
    if (rows.empty()) rows = linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, state_.theta);
    minimum_.evaluation = std::move(evaluation);
    minimum_.rows = std::move(rows);
    minimum_.prior = prior;
    derivatives_at_trial_ = true;
    if (gain_ < 0.25)
        radius_ = 0.5 * std::min(radius_, step.length);
    else if (gain_ > 0.75)
        radius_ = std::max(radius_, 2.5 * step.length);
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, record.after);
    return true;
}

}  // namespace orbid::estimator
