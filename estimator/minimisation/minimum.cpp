#include "estimator/minimisation/minimum.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "estimator/minimisation/minimisation.hpp"
#include "estimator/minimisation/plain_least_squares.hpp"

namespace orbid::estimator {

namespace {

/// After the convergence test is met, steps go on while they gain digits: at most this many.
constexpr int polishing_steps = 12;

/// Only this close to the minimum, in posterior sds, are steps extended by the factor that the last one gave.
constexpr double stretched_within_sds = 1.0;

/// This many small steps without halving what is left gain nothing any more.
constexpr int stagnant_steps = 12;

/// Steps below this many of the least changes that a residual can show (see error_limits()) are rounding; where the
/// scale is held at its floor these are its sds.
constexpr double floor_sds = 100.0;

/// An intermediate stage ends with the first accepted step that lowers the sum of squares by less than this fraction,
/// or after this many. The next stage does the rest as well. Measured on the pendulum's section series, continuity
/// lowered tenfold whenever a step gained less than 30 %: 13 to 22 steps in all from bad starts.
constexpr double provisional_gain = 0.3;
constexpr int provisional_steps = 5;

}  // namespace

std::string two_figures(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2g", value);
    return text;
}

bool Minimisation::start() {
    if (is_plain_least_squares(problem_, set_)) {
        minimum_.evaluation = solve_plain_least_squares(problem_, set_, state_, ledger_);
    } else {
        minimum_.evaluation = evaluate(problem_.residuals, set_, problem_.laws, state_.theta, state_.latents, true);
        ++ledger_.evaluations;
    }
    if (!minimum_.evaluation.failed.empty()) {
        minimum_.stopped = minimum_.evaluation.failed;
        minimum_.outcome = Outcome::start_failed;
        return false;
    }
    minimum_.rows = linearise(set_, problem_.laws, minimum_.evaluation.values, problem_.coordinates, state_.theta);
    minimum_.prior = prior_at(problem_, state_.u);
    minimum_.error_at_floor.assign(problem_.errors.size(), false);
    minimum_.error_at_ceiling = minimum_.error_at_floor;
    // The first constraints are as loose as they are violated.
    minimum_.matching = std::clamp(violation(set_, minimum_.evaluation.values), exact_matching, 1e6);
    latent_fit_ = latent_fit_sizes(problem_, set_, state_, minimum_.rows, minimum_.matching);
    start_errors();
    return true;
}

/// Scales without a start. Where states start on their readings and are held together loosely, the readings' errors are
/// those that the gaps ask for. Only the ratio to the continuity sd matters, which the stages go through.
void Minimisation::start_errors() {
    if (state_.errors_known || (set_.provisional && ledger_.round > 1)) return;
    const ErrorLimits limit = limits();
    const Eigen::VectorXd gaps = set_.provisional ? gap_sizes(problem_, set_, minimum_.rows) : Eigen::VectorXd();
    for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
        const auto i = static_cast<Eigen::Index>(k);
        if (!problem_.errors[k].start_unknown()) continue;
        state_.psi[i] = set_.provisional ? std::max(std::isfinite(gaps[i]) ? gaps[i] : limit.size[i], limit.floor[i])
                                         : std::max({limit.size[i], limit.floor[i], latent_fit_[i]});
    }
    state_.errors_known = !set_.provisional;
}

Minimum Minimisation::run() {
    if (!start() || !update_errors(false)) return std::move(minimum_);
    radius_ = initial_radius();
    while (true) {
        note_remaining();
        const Next next = decide();
        if (next == Next::end) break;
        if (next == Next::stage) {
            pace_.rejected = pace_.stagnant = 0;
            pace_.least = infinity;
        } else if (!go_on()) {
            break;
        }
    }
    return std::move(minimum_);
}

/// The full step that is left, and whether what is left still becomes less.
void Minimisation::note_remaining() {
    const TrialStep& full = full_step();
    minimum_.step = full.parameters;
    minimum_.remaining = std::sqrt(std::max(full.curvature, 0.0));
    if (minimum_.remaining < 0.5 * pace_.least) {
        pace_.least = minimum_.remaining;
        pace_.stagnant = 0;
    } else {
        ++pace_.stagnant;
    }
}

/// Whether further steps would not add digits to a minimum that is already good enough.
bool Minimisation::gains_no_digits() const {
    return minimum_.remaining < polished_sds || pace_.polishing >= polishing_steps || pace_.rejected > 0 ||
           (pace_.polishing > 1 && minimum_.remaining > 0.8 * pace_.last);
}

/// Whether the step that is left is not more than the residuals' rounding.
bool Minimisation::within_rounding() const {
    // With a scale at its floor a sd is itself the rounding of the residuals.
    const bool at_floor =
        std::any_of(minimum_.error_at_floor.begin(), minimum_.error_at_floor.end(), [](bool floor) { return floor; });
    return minimum_.remaining < std::max(rounding_sds, floor_sds * (at_floor ? 1.0 : std::min(rounding_, 1.0)));
}

/// Whether this stage has nothing left to give.
bool Minimisation::exhausted() const {
    // Nothing below rounding can be gained by shorter steps still.
    if (pace_.rejected >= 30 || radius_ < 1e-14 * model_.damping.cwiseProduct(model_.fallback).norm()) return true;
    // Steps may also continue forever within rounding: tight links make it large.
    return within_rounding() && (pace_.rejected >= 4 || (set_.latents > 0 && pace_.stagnant >= stagnant_steps));
}

/// Another step, the next stage of the constraints, or the end, with its outcome.
Minimisation::Next Minimisation::decide() {
    const bool met = minimum_.remaining < problem_.options.step_tolerance;
    const std::string left = two_figures(minimum_.remaining) + " posterior sds";
    if (met && tighten(true)) return Next::stage;
    if (met && gains_no_digits()) {
        conclude(Outcome::converged,
                 "the full step that is left is " + left + ", below " + two_figures(problem_.options.step_tolerance));
        return Next::end;
    }
    if (problem_.options.interrupted && problem_.options.interrupted()) {
        conclude(Outcome::interrupted, "interrupted after " + std::to_string(ledger_.iterations) + " steps");
        return Next::end;
    }
    if (exhausted()) {
        if (tighten(true)) return Next::stage;
        if (within_rounding())
            conclude(Outcome::converged, "no shorter step decreases the objective and the full step that is left is " +
                                             left + ": the rounding of the residuals is reached");
        else
            conclude(Outcome::no_progress,
                     "no step decreases the objective although the full step that is left is " + left);
        return Next::end;
    }
    if (ledger_.trials >= problem_.options.maximum_iterations) {
        conclude(Outcome::iteration_limit, "the limit of " + std::to_string(problem_.options.maximum_iterations) +
                                               " steps is reached; the full step that is left is " + left);
        return Next::end;
    }
    if (met) ++pace_.polishing;
    return Next::step;
}

/// One trial. @return false: the minimisation is over
bool Minimisation::go_on() {
    pace_.last = minimum_.remaining;
    const TrialStep& full = full_step();
    TrialStep step = full.length <= 1.1 * radius_ ? full : step_within(model_, radius_);
    if (set_.constraints > 0 && minimum_.matching > exact_matching) ++stage_trials_;
    if (unsettled()) return false;
    last_step_full_ = step.mu == 0.0;
    if (last_step_full_ && pace_.rejected == 0 && minimum_.remaining < stretched_within_sds) stretch(step, stretch_);
    if (try_step(step)) return after_step();
    // Eight shortenings are a factor of 65000: no step worth taking gets past this block.
    return ++pace_.rejected != 8 || !stopped_blocks([this](std::size_t b) { return cut_[b]; });
}

/// What an accepted step asks for. @return false: the minimisation is over
bool Minimisation::after_step() {
    pace_.rejected = 0;
    for (std::size_t b = 0; b < failures_.size(); ++b) {
        failures_[b] = cut_[b] ? failures_[b] + 1 : 0;
        cut_[b] = false;
    }
    if (stopped_blocks([this](std::size_t b) { return failures_[b] >= 3; })) return false;
    if (!update_errors(last_step_full_ && gain_ > 0.5 && gain_ < 1.5)) return false;
    tighten(false);
    if (!set_.provisional) return true;
    if (accepted_ < provisional_steps && last_decrease_ >= provisional_gain * last_objective_) return true;
    conclude(Outcome::converged, "a provisional round is over");
    return false;
}

ErrorProblem error_problem(const Problem& problem, const BlockSet& set, const Minimum& minimum, Follow follow) {
    ErrorProblem errors;
    errors.set = &set;
    errors.laws = &problem.laws;
    errors.rows = in_basis(minimum.rows, minimum.step.from_data);
    errors.prior_rows = minimum.prior.rows * minimum.step.decided;
    errors.prior_gradient = minimum.step.decided.transpose() * minimum.prior.gradient;
    errors.free = free_errors(problem, set);
    errors.matching = minimum.matching;
    errors.restricted = problem.options.variance == Variance::restricted;
    errors.follow = follow;
    return errors;
}

Minimum minimise(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger) {
    const State start = state;
    Minimisation unlimited(problem, set, state, ledger, false);
    Minimum minimum = unlimited.run();
    if (!unlimited.unsettled()) return minimum;
    state = start;
    return Minimisation(problem, set, state, ledger, true).run();
}

}  // namespace orbid::estimator
