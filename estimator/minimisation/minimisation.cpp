#include "estimator/minimisation/minimisation.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "estimator/minimisation/plain_least_squares.hpp"

namespace orbid::estimator {

bool Minimisation::start(const std::function<void()>& begun) {
    if (is_plain_least_squares(problem_, set_)) {
        PlainSolution found = solve_plain_least_squares(problem_, set_, state_, ledger_);
        minimum_.evaluation = std::move(found.evaluation);
        if (found.exhausted) stopping_.expect_no_digits();
    } else {
        minimum_.evaluation = evaluate(problem_.residuals, set_, problem_.laws, state_.theta, state_.latents, true);
        ++ledger_.evaluations;
    }
    if (begun) begun();
    if (minimum_.evaluation.any_failed) {
        minimum_.stopped = minimum_.evaluation.failed;
        minimum_.outcome = Outcome::start_failed;
        return false;
    }
    minimum_.take_rows(problem_, set_, state_);
    minimum_.prior = prior_at(problem_, state_.u);
    minimum_.error_at_floor.assign(problem_.errors.size(), false);
    minimum_.error_at_ceiling = minimum_.error_at_floor;
    minimum_.matching = ConstraintStages::first(violation(set_, minimum_.errors));
    errors_.start(minimum_, state_, ledger_.round);
    return true;
}

Minimum Minimisation::run(const std::function<void()>& begun) {
    using enum Decision::Next;
    if (!start(begun) || !update_errors()) return std::move(minimum_);
    tell_step({.iteration = ledger_.iterations,
               .round = ledger_.round,
               .provisional = set_.provisional,
               .objective = objective()},
              problem_, state_.theta);
    radius_ = initial_radius();
    while (true) {
        const Standing at = standing();
        const Decision decision = stopping_.decide(at);
        if (decision.next == stage) {
            tighten();
        } else if (decision.next == end) {
            if (settle_errors()) continue;
            if (decision.outcome == Outcome::converged && release_held()) continue;
            conclude(decision.outcome, decision.message + held_message_);
            if (decision.outcome != Outcome::no_progress || !passes_kink()) break;
        } else if (stopping_.held_up(at) && hold_few()) {
            continue;
        } else if (!go_on()) {
            break;
        }
    }
    return std::move(minimum_);
}

Standing Minimisation::standing() {
    const TrialStep& full = full_step();
    minimum_.step = full.parameters;
    minimum_.remaining = std::sqrt(std::max(full.curvature, 0.0));
    // Posterior sds are those of rounding only where no other error makes them.
    const std::vector<bool>& floor = minimum_.error_at_floor;
    const bool at_floor = !floor.empty() && std::all_of(floor.begin(), floor.end(), [](bool one) { return one; });
    return {minimum_.remaining, errors_.rounding(), at_floor,
            radius_ < 1e-14 * model_.damping.cwiseProduct(model_.fallback).norm(), stages_.left(minimum_.matching)};
}

/// One trial. @return false: the minimisation is over
bool Minimisation::go_on() {
    const TrialStep& full = full_step();
    TrialStep step = full.length <= 1.1 * radius_ ? full : step_within(model_, full, radius_);
    stages_.count_trial(minimum_.matching);
    if (unsettled()) return false;
    if (step.mu == 0.0 && !stopping_.after_rejection() && minimum_.remaining < stretched_within_sds)
        stretch(step, stretch_);
    if (try_step(step)) return after_step();
    return !end_at(stopping_.rejected());
}

/// What an accepted step asks for. @return false: the minimisation is over
bool Minimisation::after_step() {
    if (end_at(stopping_.accepted()) || !update_errors()) return false;
    if (stages_.decide(last_, minimum_.matching)) tighten();
    if (!stopping_.ends_intermediate_stage(last_)) return true;
    conclude(Outcome::converged, "a provisional round is over");
    return false;
}

/// Ends the minimisation where blocks stopped too many steps. @return whether some did
bool Minimisation::end_at(std::vector<std::size_t> stopped) {
    if (!set_.spread.any(!stopped.empty())) return false;
    minimum_.stopped = std::move(stopped);
    minimum_.outcome = Outcome::blocks_stopped;
    return true;
}

/// The error parameters at a new point. @return false: they cannot be estimated
bool Minimisation::update_errors() {
    factorise_errors();
    set_model();
    if (set_.provisional && stopping_.at_start()) {
        const Eigen::VectorXd psi = errors_.followed(minimum_, state_, ledger_.round);
        if (psi != state_.psi)
            rescale([&] {
                state_.psi = psi;
                factorise_errors();
            });
    }
    const ErrorUpdates::Decision decision = errors_.decide(minimum_, standard_.arrow, state_.psi, last_);
    std::string refusal = decision.refusal;
    if (decision.search) {
        search_errors(decision.follow);
        refusal = errors_.refusal(minimum_, state_.psi);
    }
    if (!refusal.empty()) {
        conclude(Outcome::no_freedom, refusal);
        return false;
    }
    factorise_steps();
    return true;
}

/// The error parameters where the next step would take them, if none follows. @return whether they moved
bool Minimisation::settle_errors() {
    if (!errors_.take_due(state_.psi)) return false;
    rescale([this] { factorise_errors(); });
    factorise_steps();
    return true;
}

/// The error parameters at their minimum.
void Minimisation::search_errors(Follow follow) {
    std::optional<WhitenedArrow> standard;
    const bool dropped = is_long(set_);
    if (one_curvature_) standard = std::move(standard_);
    if (dropped) drop_factors();
    const Eigen::VectorXd psi = errors_.searched(follow, model_length_, state_, minimum_, ledger_, standard);
    if (!one_curvature_) standard.reset();
    if (psi != state_.psi) {
        rescale([&] {
            state_.psi = psi;
            standard ? take_factor(*std::move(standard)) : factorise_errors();
        });
    } else if (standard && !dropped) {
        standard_ = *std::move(standard);
    } else if (standard) {
        take_factor(*std::move(standard));
    } else if (one_curvature_ || dropped) {
        factorise_errors();
    }
}

/// The next stage of the constraints.
void Minimisation::tighten() {
    rescale([this] {
        minimum_.matching = stages_.begin_next(minimum_.matching);
        errors_.take_due(state_.psi);
        factorise_errors();
    });
    errors_.forget_curvature();
    radius_ = std::max(radius_, initial_radius());
}

}  // namespace orbid::estimator
