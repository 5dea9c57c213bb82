#include "estimator/minimisation/error_updates.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace orbid::estimator {

namespace {

/// With steps this long, in posterior sds, an estimate ends that is only the start of another one.
constexpr double rough_estimate = 1e-2;

}  // namespace

void ErrorUpdates::start(const Minimum& minimum, State& state, int round) {
    const bool known = state.errors_known || (set_.provisional && round > 1);
    const std::vector<bool> free = free_errors(problem_, set_);
    // A factorisation, for nothing where no scale is begun or searched.
    if (!known || std::find(free.begin(), free.end(), true) != free.end())
        latent_fit_ = latent_fit_sizes(problem_, set_, state, minimum.rows, minimum.matching);
    if (known) return;
    const ErrorLimits limit = error_limits(problem_, set_, state, minimum.rows, latent_fit_);
    const Eigen::VectorXd gaps = set_.provisional ? gap_sizes(problem_, set_, minimum.rows) : Eigen::VectorXd();
    for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
        const auto i = static_cast<Eigen::Index>(k);
        if (!problem_.errors[k].start_unknown()) continue;
        state.psi[i] = set_.provisional ? std::max(std::isfinite(gaps[i]) ? gaps[i] : limit.size[i], limit.floor[i])
                                        : std::max({limit.size[i], limit.floor[i], latent_fit_[i]});
    }
    state.errors_known = !set_.provisional;
}

Eigen::VectorXd ErrorUpdates::followed(const Minimum& minimum, const State& state, int round) const {
    if (state.errors_known || round <= 1) return state.psi;
    ErrorProblem errors = error_problem(problem_, set_, minimum, Follow::latents);
    bool any = false;
    for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
        errors.free[k] = problem_.errors[k].start_unknown() && problem_.errors[k].estimate;
        any = any || errors.free[k];
    }
    if (!any) return state.psi;
    const ErrorPoint point = evaluate_errors(errors, state.psi);
    Eigen::VectorXd psi = state.psi;
    for (const NoiseModel& law : problem_.laws) {
        const Eigen::Index k = law.first;
        const double count = set_.count[law.channels.front()];
        if (!errors.free[static_cast<std::size_t>(k)] || !law.compressible() || !(count > 0.0)) continue;
        psi[k] += 0.5 * std::log(std::max((point.fit[k] + count - point.left[k]) / count, 1e-290));
        psi[k] = std::clamp(psi[k], law.coordinates.front().lower, law.coordinates.front().upper);
    }
    return psi;
}

ErrorUpdates::Decision ErrorUpdates::decide(const Minimum& minimum, const BlockArrow& arrow, const Eigen::VectorXd& psi,
                                            const StepTaken& last) const {
    Decision decision;
    const std::vector<bool> free = free_errors(problem_, set_);
    if (std::find(free.begin(), free.end(), true) == free.end()) return decision;
    const Eigen::Index dead = undetermined_states(arrow);
    const Eigen::Index taken = set_.latents - dead - set_.constraints + minimum.step.space.data.cols();
    decision.refusal = set_.records > taken
                           ? refusal(minimum, psi)
                           : std::to_string(set_.records) + " records cannot determine " + std::to_string(taken) +
                                 " parameters and latent states and an error scale as well";
    decision.search = decision.refusal.empty();
    // The quadratic model is trusted with theta as well where it was right about the last step.
    bool profile = last.full && last.gain > 0.5 && last.gain < 1.5;
    for (std::size_t i = 0; i < minimum.step.active.size(); ++i)
        if (minimum.step.active[i] != 0 && minimum.step.d[static_cast<Eigen::Index>(i)] != 0.0) profile = false;
    if (profile) decision.follow = Follow::all;
    return decision;
}

Eigen::VectorXd ErrorUpdates::searched(Follow follow, double length, const State& state, Minimum& minimum,
                                       SolverStatistics& ledger, std::optional<WhitenedArrow>& standard) {
    const ErrorProblem errors = error_problem(problem_, set_, minimum, follow);
    const ErrorLimits limit = error_limits(problem_, set_, state, minimum.rows, latent_fit_);
    rounding_ = limit.rounding;
    // Scales of long data need not be better than the parameters, which have this far to go; while that is far the next
    // step repeats the search. Short data are searched to the end, unless the estimate is itself a rough one. That
    // costs little, and the likelihood of two scales may have another minimum nearby, where one of them is zero. Errors
    // that are not normal take all records, also without latent states.
    ErrorSearch search;
    if (is_long(set_) || set_.records >= many_records || problem_.options.step_tolerance >= rough_estimate) {
        search.tolerance = std::clamp(1e-3 * length, 1e-12, 1e-2);
        search.known = &curvature_;
        if (length > std::max(1e-2, 10.0 * problem_.options.step_tolerance)) search.untried = 0.1;
    }
    ErrorMinimum found =
        minimise_errors(errors, state.psi, limit.floor, limit.ceiling, search, std::exchange(standard, std::nullopt));
    if (found.steps > 0)
        ledger.history.push_back({ledger.round, StepBlock::scales, true, found.before, found.after, 0.0,
                                  StepRejection::none, set_.provisional});
    minimum.error_at_floor = found.at_floor;
    minimum.error_at_ceiling = found.at_ceiling;
    if (problem_.options.variance == Variance::integrated) {
        const Eigen::VectorXd psi = integrated_scales(errors, found);
        if (psi != found.psi) return psi;
    }
    standard = std::move(found.standard);
    // What is factorised serves the next step too, whose errors those of psi are to first order.
    if (!standard) return found.psi;
    if (found.psi != found.evaluated) due_ = std::move(found.psi);
    return found.evaluated;
}

bool ErrorUpdates::take_due(Eigen::VectorXd& psi) {
    if (due_.size() == 0) return false;
    psi = std::exchange(due_, {});
    return true;
}

}  // namespace orbid::estimator
