#include "estimator/estimate/estimate.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "estimator/estimate/estimate_over_ranks.hpp"
#include "estimator/estimate/estimate_report.hpp"
#include "estimator/estimate/outer_loop.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/problem.hpp"
#include "estimator/problem/rank_share.hpp"
#include "estimator/problem/tie.hpp"
#include "estimator/uncertainty/posterior.hpp"
#include "estimator/uncertainty/verdict.hpp"
#include "models/system/stopped.hpp"

namespace orbid::estimator {

namespace {

EstimateStatus status_of(Outcome outcome) {
    if (outcome == Outcome::converged) return EstimateStatus::converged;
    if (outcome == Outcome::iteration_limit) return EstimateStatus::iteration_limit;
    if (outcome == Outcome::interrupted) return EstimateStatus::interrupted;
    const bool stuck = outcome == Outcome::no_progress || outcome == Outcome::blocks_stopped;
    return stuck ? EstimateStatus::no_progress : EstimateStatus::failed;
}

/// Full Hessian and verdict, as far as asked for. A stop leaves the estimate without them.
void judge_estimate(const Problem& problem, const OuterLoop& rounds, const State& state, Posterior& posterior,
                    Estimate& result) try {
    const EstimateOptions& options = problem.options;
    const bool at_floor = std::any_of(rounds.minimum.error_at_floor.begin(), rounds.minimum.error_at_floor.end(),
                                      [](bool floor) { return floor; });
    result.hessian_ratio = Eigen::VectorXd::Constant(state.u.size(), nan_value);
    if (at_floor || !(options.verdict || options.full_hessian)) return;
    const LatentCourse course(posterior.arrow(), posterior.reduced_problem());
    posterior.drop_factors();
    const FullHessian hessian =
        full_hessian(problem, rounds.set, state, rounds.minimum, posterior, course, result.evaluations);
    result.hessian_ratio = hessian.ratio;
    if (options.full_hessian && hessian.definite) result.log_integral -= 0.5 * hessian.ln_determinant;
    if (!options.verdict) return;
    const Verdict verdict =
        judge(problem, rounds.set, state, rounds.minimum, posterior, course, hessian, result.evaluations);
    result.trust_normal = verdict.trust;
    result.distrust = verdict.reason;
} catch (const models::Stopped&) {
}

/// Where an estimate runs: alone, or on one of several ranks.
struct Place {
    Collective* ranks = nullptr;
    ChainShare share;
};

Estimate estimate_at(const Place& place, const std::vector<FreeParameter>& parameters,
                     const std::vector<const Residual*>& residuals, const std::vector<DerivedQuantity>& derived,
                     const EstimateOptions& options) {
    if (any_tied(parameters)) {
        const TiedProblem tied = resolve_ties(parameters, residuals, options.joint_priors);
        EstimateOptions reduced = options;
        if (options.watched)
            reduced.watched = [&](StepReport report) {
                report.theta = tied.map.expand(report.theta);
                options.watched(report);
            };
        Estimate result = estimate_at(place, tied.parameters, tied.residuals, tied.derived(derived), reduced);
        tied.expand(result);
        return result;
    }
    std::vector<ActiveSet> active = initial_sets(residuals);
    Problem problem = set_up(parameters, residuals, active, derived, options);
    problem.ranks = place.ranks;
    problem.share = place.share;
    State state = initial_state(problem, active);
    if (place.ranks != nullptr) check_alike(problem, state);
    OuterLoop rounds(problem, state, std::move(active));
    rounds.run();

    Estimate result;
    result.status = status_of(rounds.minimum.outcome);
    result.message = rounds.minimum.message;
    result.counts = rounds.counts;
    for (std::size_t r = 0; r < residuals.size(); ++r)
        for (const BlockLayout& block : rounds.set.active[r].layout)
            if (!block.active) result.counts[r].unused.push_back(block.label);
    result.iterations = rounds.ledger.iterations;
    result.evaluations = rounds.ledger.evaluations;
    result.rounds = rounds.ledger.round;
    result.remaining = rounds.minimum.remaining;
    result.history = rounds.ledger.history;
    if (result.status == EstimateStatus::failed) {
        report_failure(problem, state, result);
        result.active = std::move(rounds.set.active);
        return result;
    }
    tell_step({.phase = StepReport::Phase::uncertainty,
               .iteration = result.iterations,
               .round = result.rounds,
               .objective = rounds.ledger.history.empty() ? nan_value : rounds.ledger.history.back().after},
              problem, state.theta);
    Posterior posterior(problem, rounds.set, state, rounds.minimum);
    report(problem, rounds.set, state, rounds.minimum, posterior, derived, result);
    result.log_integral = posterior.log_integral();
    result.objective = posterior.objective();
    result.log_likelihood = posterior.log_likelihood();
    result.degrees_of_freedom = posterior.degrees_of_freedom();
    // Only minima are compared from here on, and each has rows of its own.
    rounds.minimum.rows = {};
    judge_estimate(problem, rounds, state, posterior, result);
    report_blocks(problem, rounds.set, state, rounds.minimum, posterior, result);
    if (rounds.minimum.kink) {
        result.trust_normal = false;
        result.distrust = "the minimum lies at a kink of the objective, whose sides have different curvatures";
    }
    result.active = std::move(rounds.set.active);
    return result;
}

}  // namespace

Estimate estimate(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                  const std::vector<DerivedQuantity>& derived, const EstimateOptions& options) {
    return estimate_at({}, parameters, residuals, derived, options);
}

Estimate estimate_over_ranks(const std::vector<FreeParameter>& parameters,
                             const std::vector<const Residual*>& residuals, const ChainShare& share, Ranks& ranks,
                             const std::vector<DerivedQuantity>& derived, const EstimateOptions& options) {
    const auto refuse = [](const std::string& option, const std::string& needed) {
        throw std::invalid_argument("an estimate over ranks cannot use " + option + ": " + needed);
    };
    if (options.clusters != Clusters::none) refuse("clusters of records", "EstimateOptions::clusters must be none");
    if (options.verdict) refuse("the check of the normal approximation", "EstimateOptions::verdict must be false");
    if (options.full_hessian) refuse("the full Hessian", "EstimateOptions::full_hessian must be false");
    Collective collective(ranks);
    Estimate result = estimate_at({&collective, share}, parameters, residuals, derived, options);
    collective.meet();
    return result;
}

}  // namespace orbid::estimator
