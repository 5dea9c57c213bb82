#include "estimator/minimisation/minimum.hpp"

#include <cstdio>

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

Minimum minimise(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger) {
    const State start = state;
    Minimisation unlimited(problem, set, state, ledger, false);
    Minimum minimum = unlimited.run();
    if (!unlimited.unsettled()) return minimum;
    state = start;
    return Minimisation(problem, set, state, ledger, true).run();
}

}  // namespace orbid::estimator
