#include "estimator/minimisation/stopping.hpp"

#include "tests/catch.hpp"

namespace orbid::tests::stopping_test {

TEST_CASE("what rounding stops has converged only with less than a tenth of a sd left", "[estimator]") {
    const estimator::Problem problem;
    const estimator::BlockSet set;
    const estimator::SolverStatistics ledger;
    struct Row {
        double remaining, rounding;
        bool at_floor;
        estimator::Outcome outcome;
    };
    using enum estimator::Outcome;
    for (const Row& row :
         {Row{0.05, 1.0, false, converged}, Row{0.2, 1.0, false, no_progress}, Row{14.0, 1.0, false, no_progress},
          Row{0.05, 1e-9, false, no_progress}, Row{5e-4, 0.0, false, converged}, Row{0.5, 1.0, true, converged}}) {
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

}  // namespace orbid::tests::stopping_test
