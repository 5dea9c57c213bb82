#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

/// The state after a step, on bounds exactly where the step rests on them.
State Minimisation::moved(const TrialStep& step) const {
    State state = state_;
    for (Eigen::Index i = 0; i < state.u.size(); ++i) {
        const int side = step.parameters.active[static_cast<std::size_t>(i)];
        state.u[i] = std::clamp(state_.u[i] + step.parameters.d[i], stages_.lower()[i], stages_.upper()[i]);
        if (side != 0) state.u[i] = side < 0 ? stages_.lower()[i] : stages_.upper()[i];
    }
    state.theta = natural_parameters(problem_, state.u);
    for (std::size_t b = 0; b < set_.blocks.size(); ++b)
        state.latents[set_.blocks[b].residual][set_.blocks[b].block] += step.latents[b];
    return state;
}

/// The end of a step with the change of the objective, which stays infinite where it cannot be evaluated.
Minimisation::Trial Minimisation::evaluated(const TrialStep& step) {
    Trial trial;
    trial.state = moved(step);
    trial.prior = prior_at(problem_, trial.state.u);
    if (!std::isfinite(trial.prior.value)) return trial;
    trial.evaluation = evaluate_trial(problem_.residuals, set_, problem_.laws, trial.state.theta, trial.state.latents,
                                      derivatives_at_trial_);
    ++ledger_.evaluations;
    if (trial.evaluation.any_failed) {
        for (const std::size_t b : trial.evaluation.failed)
            stopping_.note_failure(b);
        trial.reason = StepRejection::block_failed;
        return trial;
    }
    const BlockErrors to(trial.evaluation.values);
    trial.change = trial.prior.value - minimum_.prior.value;
    trial.change += value_change(set_, problem_.laws, state_.psi, minimum_.errors, to);
    if (set_.constraints > 0)
        trial.change += violation_change(set_, minimum_.errors, to) / (minimum_.matching * minimum_.matching);
    trial.curvature = 2.0 * (trial.change - step.slope);
    if (derivatives_at_trial_ && (step.curvature < gradient_judged_sds * gradient_judged_sds ||
                                  (stopping_.after_rejection() && judged_by_gradients(step.curvature))))
        compare_slopes(step, trial);
    // Step length of the parabola through both values and the first slope.
    if (trial.change > 0.0) trial.keep = std::clamp(-0.5 * step.slope / (trial.change - step.slope), 0.1, 0.5);
    return trial;
}

/// Whether the least change that residuals can show hides the gain of a step of this squared length: with links as
/// tight as rounding that may be a step of whole sds.
bool Minimisation::judged_by_gradients(double curvature) const {
    const double hidden = std::min(hidden_roundings * errors_.rounding(), 1.0);
    return set_.latents > 0 && curvature < hidden * hidden;
}

/// Tiny steps: the gradients at both ends keep what the difference of two objectives loses to rounding.
void Minimisation::compare_slopes(const TrialStep& step, Trial& trial) const {
    const double slope =
        slopes_along(set_, trial.evaluation.values, problem_.coordinates, trial.state.theta, problem_.laws,
                     {state_.psi, minimum_.matching, curvature()}, {{step.parameters.d, step.latents}})[0] +
        trial.prior.gradient.dot(step.parameters.d);
    trial.change = 0.5 * (step.slope + slope);
    trial.curvature = slope - step.slope;
    trial.slopes_compared = true;
}

/// Whether a trial lowers the objective enough, and has the derivatives that the next step needs.
bool Minimisation::decreases(Trial& trial) {
    if (!(trial.change < 0.0) || !(trial.gain > least_gain)) {
        if (trial.reason == StepRejection::none) trial.reason = StepRejection::no_decrease;
        return false;
    }
    if (derivatives_at_trial_) return true;
    trial.evaluation =
        evaluate_trial(problem_.residuals, set_, problem_.laws, trial.state.theta, trial.state.latents, true);
    ++ledger_.evaluations;
    if (trial.evaluation.any_failed) trial.reason = StepRejection::block_failed;
    return !trial.evaluation.any_failed;
}

/// @param misfit  where the step began
void Minimisation::adopt(const TrialStep& step, Trial trial, double misfit) {
    last_ = {trial.gain, -trial.change, misfit, step.mu == 0.0};
    stretch_ = last_.full && last_.gain > 0.3 && trial.curvature > 0.0
                   ? stretch_of_next(step.curvature / trial.curvature)
                   : 1.0;
    ++ledger_.iterations;
    state_ = std::move(trial.state);
    errors_.take_due(state_.psi);
    minimum_.evaluation = std::move(trial.evaluation);
    drop_factors();
    minimum_.take_rows(problem_, set_, state_);
    minimum_.prior = std::move(trial.prior);
    derivatives_at_trial_ = true;
    if (last_.gain < 0.25)
        radius_ = 0.5 * std::min(radius_, step.length);
    else if (last_.gain > 0.75)
        radius_ = std::max(radius_, 2.5 * step.length);
}

bool Minimisation::try_step(const TrialStep& step) {
    ++ledger_.trials;
    const double before = objective();
    const double misfit_before = misfit();
    excess_.expect(standard_.arrow, step);
    // Values with derivatives take as much memory as factors. Most steps are accepted, and others factorise again.
    const bool dropped = is_long(set_);
    if (dropped) drop_factors();
    Trial trial = evaluated(step);
    const double predicted = step.predicted_decrease();
    if (predicted > 0.0) trial.gain = -trial.change / predicted;
    if (!trial.evaluation.any_failed && predicted > 0.0)
        excess_.compare(state_.psi, minimum_.errors, trial.evaluation.values, trial.gain);
    const bool accepted = decreases(trial);
    const double after = accepted ? before + trial.change : before;
    ledger_.history.push_back(
        {ledger_.round, StepBlock::theta, accepted, before, after, step.mu, trial.reason, set_.provisional});
    if (!accepted) {
        radius_ = trial.keep * std::min(radius_, step.length);
        // Where rounding may hide what the next step gains, gradients at both ends judge it.
        derivatives_at_trial_ = judged_by_gradients(0.25 * step.curvature);
        trial = {};
        if (!excess_.of_blocks().empty())
            factorise_steps();
        else if (dropped)
            factorise_errors();
        return false;
    }
    adopt(step, std::move(trial), misfit_before);
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, after);
    tell_step({.iteration = ledger_.iterations,
               .round = ledger_.round,
               .provisional = set_.provisional,
               .objective = after,
               .decrease = before - after,
               .damping = step.mu,
               .step = minimum_.remaining},
              problem_, state_.theta);
    return true;
}

}  // namespace orbid::estimator
