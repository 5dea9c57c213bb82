#include "estimator/minimisation/stopping.hpp"

#include "tests/catch.hpp"

namespace orbid::tests::stopping_test {

TEST_CASE("what stops has converged only with less than a tenth of a sd left", "[estimator]") {
    const estimator::Problem problem;
    estimator::BlockSet set;
    set.linked = true;
    const estimator::SolverStatistics ledger;
    struct Row {
        double remaining, rounding;
        bool at_floor;
        estimator::Outcome outcome;
    };
    using enum estimator::Outcome;
    for (const Row& row :
         {Row{0.05, 1.0, false, converged}, Row{0.2, 1.0, false, no_progress}, Row{14.0, 1.0, false, no_progress},
          Row{0.05, 1e-9, false, converged}, Row{0.15, 1e-9, false, no_progress}, Row{5e-4, 0.0, false, converged},
          Row{0.5, 1.0, true, converged}}) {
        CAPTURE(row.remaining, row.rounding);
        estimator::Stopping stopping(problem, set, ledger);
        estimator::Standing standing;
        standing.remaining = row.remaining;
        standing.rounding = row.rounding;
        standing.at_floor = row.at_floor;
        standing.radius_vanished = true;
        const estimator::Decision decision = stopping.decide(standing);
        CHECK(decision.next == estimator::Decision::Next::end);
        CHECK(decision.outcome == row.outcome);
        if (row.outcome == no_progress && row.rounding == 1.0)
            CHECK_THAT(decision.message, ContainsSubstring("rounding of the residuals hides what it would gain"));
    }
}

TEST_CASE("steps that crawl have converged only with less than a tenth of a sd left", "[estimator]") {
    const estimator::Problem problem;
    const estimator::SolverStatistics ledger;
    for (const double remaining : {0.05, 0.2})
        for (const Eigen::Index latents : {0, 2}) {
            CAPTURE(remaining, latents);
            estimator::BlockSet set;
            set.latents = latents;
            estimator::Stopping stopping(problem, set, ledger);
            estimator::Standing standing;
            standing.remaining = remaining;
            standing.rounding = 1e-9;
            int steps = 0;
            while (steps < 100 && stopping.decide(standing).next == estimator::Decision::Next::step) {
                CHECK(stopping.accepted().empty());
                ++steps;
            }
            CHECK(steps == (remaining < 0.1 && latents > 0 ? 40 : 100));
        }
}

}  // namespace orbid::tests::stopping_test
