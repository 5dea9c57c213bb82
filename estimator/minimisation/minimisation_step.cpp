#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

namespace {

/// Steps shorter than this, in posterior sds, are judged by gradients. Computed orbits carry rounding of up to 1e-6 sds
/// of their targets. That hides the 5e-7 that a step of 1e-3 gains, and is a fiftieth of the 5e-5 of a step of 1e-2.
constexpr double tiny_sds = 1e-2;

}  // namespace

/// Lists the blocks that the rule holds for as stopped. Where that is half of a residual's blocks none stands out.
bool Minimisation::stopped_blocks(const std::function<bool(std::size_t)>& rule) {
    for (std::size_t b = 0; b < set_.blocks.size(); ++b)
        if (rule(b)) minimum_.stopped.push_back(b);
    if (half_of_a_residual(set_, minimum_.stopped)) minimum_.stopped.clear();
    if (minimum_.stopped.empty()) return false;
    minimum_.outcome = Outcome::blocks_stopped;
    return true;
}

/// The state after a step, on bounds exactly where the step rests on them.
State Minimisation::moved(const TrialStep& step) const {
    State state = state_;
    for (Eigen::Index i = 0; i < state.u.size(); ++i) {
        const int side = step.parameters.active[static_cast<std::size_t>(i)];
        state.u[i] = std::clamp(state_.u[i] + step.parameters.d[i], lower_[i], upper_[i]);
        if (side != 0) state.u[i] = side < 0 ? lower_[i] : upper_[i];
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
    trial.evaluation = evaluate(problem_.residuals, set_, problem_.laws, trial.state.theta, trial.state.latents,
                                derivatives_at_trial_);
    ++ledger_.evaluations;
    if (!trial.evaluation.failed.empty()) {
        for (const std::size_t b : trial.evaluation.failed)
            cut_[b] = true;
        trial.reason = "block failed";
        return trial;
    }
    const std::vector<BlockValue>& from = minimum_.evaluation.values;
    const std::vector<BlockValue>& to = trial.evaluation.values;
    trial.change = trial.prior.value - minimum_.prior.value;
    trial.change += value_change(set_, problem_.laws, state_.psi, from, to);
    if (set_.constraints > 0)
        trial.change += violation_change(set_, from, to) / (minimum_.matching * minimum_.matching);
    trial.curvature = 2.0 * (trial.change - step.slope);
    if (derivatives_at_trial_ && step.curvature < tiny_sds * tiny_sds) compare_slopes(step, trial);
    // Step length of the parabola through both values and the first slope.
    if (trial.change > 0.0) trial.keep = std::clamp(-0.5 * step.slope / (trial.change - step.slope), 0.1, 0.5);
    return trial;
}

/// Tiny steps: the gradients at both ends keep what the difference of two objectives loses to rounding.
void Minimisation::compare_slopes(const TrialStep& step, Trial& trial) {
    trial.rows = linearise(set_, problem_.laws, trial.evaluation.values, problem_.coordinates, trial.state.theta);
    const BlockArrow arrow =
        standard_arrow(trial.rows, problem_.laws, state_.psi, minimum_.matching, curvature(), false, false).arrow;
    const double slope =
        model_change(arrow, step.parameters.d, step.latents).linear + trial.prior.gradient.dot(step.parameters.d);
    trial.change = 0.5 * (step.slope + slope);
    trial.curvature = slope - step.slope;
}

/// Whether a trial lowers the objective enough, and has the derivatives that the next step needs.
bool Minimisation::decreases(Trial& trial) {
    // A ten-thousandth of the predicted decrease is the usual least gain that still proves convergence.
    if (!(trial.change < 0.0) || !(gain_ > 1e-4)) {
        if (trial.reason.empty()) trial.reason = "no decrease";
        return false;
    }
    if (derivatives_at_trial_) return true;
    trial.evaluation = evaluate(problem_.residuals, set_, problem_.laws, trial.state.theta, trial.state.latents, true);
    ++ledger_.evaluations;
    if (!trial.evaluation.failed.empty()) trial.reason = "block failed";
    return trial.evaluation.failed.empty();
}

void Minimisation::adopt(const TrialStep& step, Trial trial) {
    // Near the minimum Gauss-Newton steps keep their direction and are too long or too short by the same factor each
    // time (Hartley's interpolation, applied to the next step).
    stretch_ = last_step_full_ && gain_ > 0.3 && trial.curvature > 0.0
                   ? std::clamp(step.curvature / trial.curvature, 0.4, 2.5)
                   : 1.0;
    ++ledger_.iterations;
    last_objective_ = misfit();
    last_decrease_ = -trial.change;
    ++accepted_;
    state_ = std::move(trial.state);
    if (trial.rows.empty())
        trial.rows = linearise(set_, problem_.laws, trial.evaluation.values, problem_.coordinates, state_.theta);
    minimum_.evaluation = std::move(trial.evaluation);
    minimum_.rows = std::move(trial.rows);
    minimum_.prior = std::move(trial.prior);
    derivatives_at_trial_ = true;
    if (gain_ < 0.25)
        radius_ = 0.5 * std::min(radius_, step.length);
    else if (gain_ > 0.75)
        radius_ = std::max(radius_, 2.5 * step.length);
}

bool Minimisation::try_step(const TrialStep& step) {
    ++ledger_.trials;
    const double before = objective();
    Trial trial = evaluated(step);
    const double predicted = step.predicted_decrease();
    gain_ = predicted > 0.0 ? -trial.change / predicted : -infinity;
    const bool accepted = decreases(trial);
    const double after = accepted ? before + trial.change : before;
    ledger_.history.push_back(
        {ledger_.round, "theta", accepted, before, after, step.mu, trial.reason, set_.provisional});
    if (!accepted) {
        radius_ = trial.keep * std::min(radius_, step.length);
        derivatives_at_trial_ = false;
        return false;
    }
    adopt(step, std::move(trial));
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, after);
    return true;
}

}  // namespace orbid::estimator
