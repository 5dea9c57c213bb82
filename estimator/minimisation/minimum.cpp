#include "estimator/minimisation/minimum.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "estimator/interface/not_finite.hpp"
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

std::string figures(const char* format, double value) {
    char text[96];
    std::snprintf(text, sizeof text, format, value);
    return text;
}

}  // namespace

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
    minimum_.matching = std::clamp(violation(set_, minimum_.evaluation.values).rms, exact_matching, 1e6);
    latent_fit_ = latent_fit_sizes(problem_, set_, state_, minimum_.rows, minimum_.matching);
    if (!state_.errors_known && set_.provisional) {
        // States that start on their readings, held together loosely: the readings' errors are as large as the gaps
        // between neighbours ask for. Only the ratio to the continuity sd matters, which the stages go through.
        if (ledger_.round <= 1) {
            const Eigen::VectorXd size = gap_sizes(problem_, set_, minimum_.rows);
            const ErrorLimits limit = limits();
            for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
                const auto i = static_cast<Eigen::Index>(k);
                if (unknown_start(k))
                    state_.psi[i] = std::max(std::isfinite(size[i]) ? size[i] : limit.size[i], limit.floor[i]);
            }
        }
    } else if (!state_.errors_known) {
        const ErrorLimits limit = limits();
        for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
            const auto i = static_cast<Eigen::Index>(k);
            if (unknown_start(k)) state_.psi[i] = std::max({limit.size[i], limit.floor[i], latent_fit_[i]});
        }
        state_.errors_known = true;
    }
    return true;
}

Minimum Minimisation::run() {
    if (!start()) return std::move(minimum_);
    if (!update_errors(false)) return std::move(minimum_);
    radius_ = initial_radius();
    int rejected = 0;
    int polish = 0;
    double last_remaining = infinity;
    double best_remaining = infinity;
    int stagnant = 0;
    while (true) {
        const TrialStep& full = full_step();
        minimum_.step = full.parameters;
        minimum_.remaining = std::sqrt(std::max(full.curvature, 0.0));
        if (minimum_.remaining < 0.5 * best_remaining) {
            best_remaining = minimum_.remaining;
            stagnant = 0;
        } else {
            ++stagnant;
        }
        const bool met = minimum_.remaining < problem_.options.step_tolerance;
        if (met && tighten(true)) {
            rejected = stagnant = 0;
            best_remaining = infinity;
            continue;
        }
        if (met && (minimum_.remaining < polished_sds || polish >= polishing_steps || rejected > 0 ||
                    (polish > 1 && minimum_.remaining > 0.8 * last_remaining))) {
            minimum_.outcome = Outcome::converged;
            minimum_.message = "the full step that is left is " + figures("%.2g", minimum_.remaining) +
                               " posterior sds, below " + figures("%.2g", problem_.options.step_tolerance);
            break;
        }
        if (problem_.options.interrupted && problem_.options.interrupted()) {
            minimum_.outcome = Outcome::interrupted;
            minimum_.message = "interrupted after " + std::to_string(ledger_.iterations) + " steps";
            break;
        }
        // Nothing below rounding can be gained by shorter steps still.
        const bool hopeless = rejected >= 30 || radius_ < 1e-14 * model_.damping.cwiseProduct(model_.fallback).norm();
        // With a scale at its floor a sd is itself the rounding of the residuals.
        const bool at_floor = std::any_of(minimum_.error_at_floor.begin(), minimum_.error_at_floor.end(),
                                          [](bool floor) { return floor; });
        const bool small =
            minimum_.remaining < std::max(rounding_sds, floor_sds * (at_floor ? 1.0 : std::min(rounding_, 1.0)));
        // Steps may also continue forever within rounding: tight links make it large.
        const bool exhausted =
            hopeless || (small && (rejected >= 4 || (set_.latents > 0 && stagnant >= stagnant_steps)));
        if (exhausted && tighten(true)) {
            rejected = stagnant = 0;
            best_remaining = infinity;
            continue;
        }
        if (exhausted) {
            minimum_.outcome = small ? Outcome::converged : Outcome::no_progress;
            minimum_.message = (small ? "no shorter step decreases the objective and the full step that is left is "
                                      : "no step decreases the objective although the full step that is left is ") +
                               figures("%.2g", minimum_.remaining) + " posterior sds" +
                               (small ? ": the rounding of the residuals is reached" : "");
            break;
        }
        if (ledger_.trials >= problem_.options.maximum_iterations) {
            minimum_.outcome = Outcome::iteration_limit;
            minimum_.message = "the limit of " + std::to_string(problem_.options.maximum_iterations) +
                               " steps is reached; the full step that is left is " +
                               figures("%.2g", minimum_.remaining) + " posterior sds";
            break;
        }
        if (met) ++polish;
        last_remaining = minimum_.remaining;
        TrialStep step = full.length <= 1.1 * radius_ ? full : step_within(model_, radius_);
        if (set_.constraints > 0 && minimum_.matching > exact_matching) ++stage_trials_;
        if (unsettled()) break;
        last_step_full_ = step.mu == 0.0;
        if (last_step_full_ && rejected == 0 && minimum_.remaining < stretched_within_sds) stretch(step, stretch_);
        if (try_step(step)) {
            rejected = 0;
            for (std::size_t b = 0; b < failures_.size(); ++b) {
                failures_[b] = cut_[b] ? failures_[b] + 1 : 0;
                cut_[b] = false;
            }
            if (stopped_blocks([this](std::size_t b) { return failures_[b] >= 3; })) break;
            if (!update_errors(last_step_full_ && gain_ > 0.5 && gain_ < 1.5)) break;
            tighten(false);
            if (set_.provisional &&
                (accepted_ >= provisional_steps || !(last_decrease_ >= provisional_gain * last_objective_))) {
                minimum_.outcome = Outcome::converged;
                minimum_.message = "a provisional round is over";
                break;
            }
            continue;
        }
        ++rejected;
        // Eight shortenings are a factor of 65000: no step worth taking gets past this block.
        if (rejected == 8 && stopped_blocks([this](std::size_t b) { return cut_[b]; })) break;
    }
    return std::move(minimum_);
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
