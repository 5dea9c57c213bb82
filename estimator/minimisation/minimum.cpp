#include "estimator/minimisation/minimum.hpp"

#include <algorithm>
#include <cstdio>
#include <optional>

#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

std::string two_figures(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2g", value);
    return text;
}

void tell_step(StepReport report, const Problem& problem, const Eigen::VectorXd& theta) {
    if (!problem.options.watched) return;
    report.theta = theta;
    problem.options.watched(report);
}

void Minimum::take_rows(const Problem& problem, const BlockSet& set, const State& state) {
    errors = BlockErrors(evaluation.values);
    rows = {};
    rows = linearise(set, problem.laws, evaluation.values, problem.coordinates, state.theta);
    if (set.latents == 0) return;
    const auto whole = [](const PartRows& part) { return part.records.rows.rows() == part.records.count; };
    const bool all = std::all_of(rows.begin(), rows.end(), [&](const BlockRows& block) {
        return std::all_of(block.parts.begin(), block.parts.end(), whole) &&
               std::all_of(block.linked_parts.begin(), block.linked_parts.end(), whole);
    });
    if (all) evaluation.values = {};
}

std::vector<BlockRows> Minimum::all_rows(const Problem& problem, const BlockSet& set, const State& state) const {
    if (evaluation.values.empty()) return rows;
    return linearise(set, problem.laws, evaluation.values, problem.coordinates, state.theta, false);
}

ErrorProblem error_problem(const Problem& problem, const BlockSet& set, const Minimum& minimum, Follow follow) {
    ErrorProblem errors;
    errors.set = &set;
    errors.laws = &problem.laws;
    errors.rows = &minimum.rows;
    errors.basis = minimum.step.from_data;
    errors.prior_rows = minimum.prior.rows * minimum.step.decided;
    errors.prior_gradient = minimum.step.decided.transpose() * minimum.prior.gradient;
    errors.free = free_errors(problem, set);
    errors.matching = minimum.matching;
    errors.restricted = problem.options.variance == Variance::restricted;
    errors.follow = follow;
    return errors;
}

Minimum minimise(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger,
                 const std::function<void()>& begun) {
    // Only stages of constraints may have to begin again.
    const std::optional<State> start = set.constraints > 0 ? std::optional(state) : std::nullopt;
    {
        Minimisation unlimited(problem, set, state, ledger, false);
        Minimum minimum = unlimited.run(begun);
        if (!start || !unlimited.unsettled()) return minimum;
    }
    state = *start;
    return Minimisation(problem, set, state, ledger, true).run({});
}

}  // namespace orbid::estimator
