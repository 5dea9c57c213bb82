#include "apps/estimation/step_outlook.hpp"

#include <chrono>
#include <cmath>

#include "tests/catch.hpp"

namespace orbid::step_outlook_test {
namespace {

using apps::StepOutlook;
using estimator::StepReport;
using tests::ContainsSubstring;
using tests::WithinRel;

StepOutlook::Clock::time_point at(double seconds) {
    return StepOutlook::Clock::time_point{} +
           std::chrono::duration_cast<StepOutlook::Clock::duration>(std::chrono::duration<double>(seconds));
}

StepReport step(int iteration, double length) {
    StepReport report;
    report.iteration = iteration;
    report.round = 1;
    report.objective = 100.0 + length;
    report.decrease = 0.25;
    report.damping = 0.0;
    report.step = length;
    return report;
}

TEST_CASE("steps that shrink by a factor tell how many are still to come", "[apps][progress]") {
    StepOutlook outlook(1e-6);
    StepReport start;
    start.round = 1;
    start.objective = 1000.0;
    CHECK(outlook.after("", start, at(0.0)).words == "step 0, objective 1000");
    // One step each two seconds, each a tenth of the one before.
    for (int k = 1; k <= 3; ++k)
        CHECK(std::isnan(outlook.after("", step(k, std::pow(10.0, 1 - k)), at(2.0 * k)).remaining_s));
    const auto state = outlook.after("", step(4, 1e-3), at(8.0));
    CHECK_THAT(state.words, ContainsSubstring("step 4") && ContainsSubstring("decrease 0.25, lambda 0"));
    // From 1e-3 to 1e-6: three more.
    CHECK_THAT(state.remaining_s, WithinRel(6.0, 1e-9));
}

TEST_CASE("nothing is foreseen of steps that do not shrink, nor across rounds", "[apps][progress]") {
    StepOutlook outlook(1e-6);
    for (int k = 1; k <= 8; ++k)
        CHECK(std::isnan(outlook.after("", step(k, 5.0), at(k)).remaining_s));
    for (int k = 1; k <= 3; ++k) {
        StepReport report = step(8 + k, std::pow(10.0, -k));
        report.round = 2;
        CHECK(std::isnan(outlook.after("", report, at(8 + k)).remaining_s));
    }
    StepReport end = step(11, 0.0);
    end.phase = StepReport::Phase::uncertainty;
    CHECK_THAT(outlook.after("looser", end).words, ContainsSubstring("looser: uncertainties"));
}

}  // namespace
}  // namespace orbid::step_outlook_test
