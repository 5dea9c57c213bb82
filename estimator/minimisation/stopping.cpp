#include "estimator/minimisation/stopping.hpp"

#include <algorithm>
#include <utility>

namespace orbid::estimator {

namespace {

/// After the convergence test is met, steps go on while they gain digits: to this share of the tolerance.
constexpr double polished_share = 1e-4;

/// This many small steps without halving what is left gain nothing any more.
constexpr int stagnant_steps = 12;

/// Steps that have not halved what is left for so long go along a fold of the latent states, where the objective is
/// flat. Of 80 estimates from the pendulum's sections at noise 5e-3, 71 converged without this rule and that of
/// converged_sds, 78 with both.
constexpr int crawling_steps = 40;

/// Steps below this many of the least changes that a residual can show (see error_limits()) are rounding; where the
/// scale is held at its floor these are its sds.
constexpr double floor_sds = 100.0;

/// An intermediate stage ends with the first accepted step that lowers the sum of squares by less than this fraction,
/// or after this many. The next stage does the rest as well. Measured on the pendulum's section series, continuity
/// lowered tenfold whenever a step gained less than 30 %: 13 to 22 steps in all from bad starts.
constexpr double provisional_gain = 0.3;
constexpr int provisional_steps = 5;

}  // namespace

/// Whether what is left still becomes less.
void Stopping::note_remaining(double remaining) {
    if (remaining < 0.5 * least_) {
        least_ = remaining;
        stagnant_ = 0;
    } else {
        ++stagnant_;
    }
}

/// Whether further steps would not add digits to a minimum that is already good enough.
bool Stopping::gains_no_digits(double remaining) const {
    return !problem_.polished || remaining < polished_share * problem_.options.step_tolerance ||
           polishing_ >= polishing_steps || rejected_ > 0 || (polishing_ > 1 && remaining > 0.8 * last_);
}

/// Whether the step that is left is not more than the residuals' rounding.
bool Stopping::within_rounding(const Standing& standing) {
    // With all scales at their floor a sd is itself the rounding of the residuals.
    const double least = floor_sds * (standing.at_floor ? 1.0 : std::min(standing.rounding, 1.0));
    return standing.remaining < std::max(rounding_sds, least);
}

/// Whether this stage has nothing left to give.
bool Stopping::exhausted(const Standing& standing) const {
    // Nothing below rounding can be gained by shorter steps still.
    if (rejected_ >= enough_rejections_ || standing.radius_vanished) return true;
    // Steps may also continue forever within rounding: tight links make it large.
    return within_rounding(standing) && (rejected_ >= 4 || (set_.latents > 0 && stagnant_ >= stagnant_steps));
}

Decision Stopping::decide(const Standing& standing) {
    using enum Decision::Next;
    const EstimateOptions& options = problem_.options;
    note_remaining(standing.remaining);
    const bool met = standing.remaining < options.step_tolerance;
    const std::string left = two_figures(standing.remaining) + " posterior sds";
    const auto next_stage = [this] {
        begin_again();
        return Decision{stage, {}, {}};
    };
    if (met && standing.stages_left) return next_stage();
    if (met && gains_no_digits(standing.remaining))
        return {end, Outcome::converged,
                "the full step that is left is " + left + ", below " + two_figures(options.step_tolerance)};
    if (set_.spread.any(options.interrupted && options.interrupted()))
        return {end, Outcome::interrupted, "interrupted after " + std::to_string(ledger_.iterations) + " steps"};
    if (exhausted(standing)) {
        if (standing.stages_left) return next_stage();
        // Where rounding is the only error, sds are those of rounding: nothing else is left. Tight links make rounding
        // large beside sds of readings that err.
        const bool exact = standing.at_floor || !(set_.linked || set_.constraints > 0);
        if (standing.remaining < converged_sds || (within_rounding(standing) && exact))
            return {end, Outcome::converged,
                    "no shorter step decreases the objective and the full step that is left is " + left +
                        (within_rounding(standing) ? ": the rounding of the residuals is reached" : "")};
        return {end, Outcome::no_progress,
                "no step decreases the objective although the full step that is left is " + left +
                    (within_rounding(standing) ? ": the rounding of the residuals hides what it would gain" : "")};
    }
    if (set_.latents > 0 && !standing.stages_left && stagnant_ >= crawling_steps && standing.remaining < converged_sds)
        return {end, Outcome::converged, "steps no longer shorten the full step that is left, " + left};
    if (ledger_.trials >= options.maximum_iterations)
        return {end, Outcome::iteration_limit,
                "the limit of " + std::to_string(options.maximum_iterations) +
                    " steps is reached; the full step that is left is " + left};
    if (met) ++polishing_;
    last_ = standing.remaining;
    return {step, {}, {}};
}

bool Stopping::held_up(const Standing& standing) const {
    return set_.latents > 0 && !set_.provisional && !standing.stages_left && stagnant_ >= stagnant_steps &&
           standing.remaining >= converged_sds && !within_rounding(standing);
}

void Stopping::begin_again() {
    rejected_ = stagnant_ = 0;
    least_ = infinity;
}

/// Where these are half of a residual's blocks none stands out.
std::vector<std::size_t> Stopping::standing_out(std::vector<std::size_t> blocks) const {
    if (half_of_a_residual(set_, blocks)) blocks.clear();
    return blocks;
}

std::vector<std::size_t> Stopping::rejected() {
    // Eight shortenings are a factor of 65000: no step worth taking gets past these blocks.
    std::vector<std::size_t> stopped;
    if (++rejected_ != 8) return stopped;
    for (std::size_t b = 0; b < cut_.size(); ++b)
        if (cut_[b]) stopped.push_back(b);
    return standing_out(std::move(stopped));
}

std::vector<std::size_t> Stopping::accepted() {
    std::vector<std::size_t> stopped;
    ++accepted_;
    rejected_ = 0;
    for (std::size_t b = 0; b < failures_.size(); ++b) {
        failures_[b] = cut_[b] ? failures_[b] + 1 : 0;
        cut_[b] = false;
        if (failures_[b] >= 3) stopped.push_back(b);
    }
    return standing_out(std::move(stopped));
}

bool Stopping::ends_intermediate_stage(const StepTaken& step) const {
    return set_.provisional && !(accepted_ < provisional_steps && step.decrease >= provisional_gain * step.misfit);
}

}  // namespace orbid::estimator
