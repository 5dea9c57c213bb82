// The estimate with looser matching that checks a series: what it compares, and what it holds.

#include <string>
#include <vector>

#include "identification/strategy/identify.hpp"
#include "tests/catch.hpp"
#include "tests/identification/henon_problem.hpp"

namespace matching_check_test {

using namespace orbid;

namespace {

/// Keeps the steps of the looser estimate: the objective after each, and whether matching was looser still on the way.
class LooserObserver : public identification::Observer {
public:
    void step(const std::string& minimisation, const estimator::StepReport& report) override {
        if (minimisation != "ten times looser matching") return;
        objectives.push_back(report.objective);
        staged = staged || report.provisional;
    }

    std::vector<double> objectives;
    bool staged = false;
};

}  // namespace

TEST_CASE("looser matching keeps the errors of the readings", "[identification]") {
    // Ten times looser, matching here allows more than the readings' own errors. Estimated anew, their scales then tend
    // to zero: the objective falls by thousands in steps that hardly move the parameters.
    auto problem = tests::henon_problem(400, {2e-3, 6e-4});
    problem.series.emplace().interval = 1;
    problem.series->matching = {identification::Matching::Kind::given, 2e-4};
    LooserObserver observer;
    const auto result = identification::identify(problem, {}, observer);
    REQUIRE(result.estimate.status == estimator::EstimateStatus::converged);
    REQUIRE(result.matching.size() == 1);
    REQUIRE(result.matching[0].shift.size() == 2);
    for (const auto& [name, shift] : result.matching[0].shift) {
        CAPTURE(name, shift);
        CHECK(std::abs(shift) < 4.0);
    }
    CHECK(result.matching[0].warnings.empty());
    REQUIRE(observer.objectives.size() > 1);
    CAPTURE(observer.objectives, result.matching[0].shift);
    CHECK(observer.objectives[1] - observer.objectives.back() < 1.0);
    // The nodes of the estimate meet at its parameters; at those of the start they would not.
    CHECK_FALSE(observer.staged);
}

}  // namespace matching_check_test
