#include "apps/program/summary.hpp"

#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "apps/results/summary_table.hpp"
#include "apps/stored_run/prediction_results.hpp"
#include "tests/apps/results/made_up_estimate.hpp"
#include "tests/catch.hpp"

namespace orbid::summary_test {
namespace {

using tests::ContainsSubstring;
constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

TEST_CASE("a value shows the digits its standard deviation supports", "[apps]") {
    CHECK(apps::with_digits_of(0.31700123456, 2.5e-6) == "0.3170012");
    CHECK(apps::with_digits_of(64.0481234, 0.031) == "64.048");
    CHECK(apps::with_digits_of(4.85123e-4, 2.3e-7) == "4.8512e-04");
    CHECK(apps::with_digits_of(1234567.0, 1200.0) == "1.2346e+06");
    CHECK(apps::with_digits_of(0.0, 0.02) == "0.000");
    CHECK(apps::with_digits_of(0.5, 3.0) == "0.5");
    CHECK(apps::with_digits_of(-0.317, undefined) == "-0.317");
    CHECK(apps::with_digits_of(1.0 / 3.0, 0.0) == "0.333333");
    CHECK(apps::with_digits_of(undefined, 1.0) == "undefined");
    CHECK(apps::percent(3.2e-6) == "+0.00032 %");
    CHECK(apps::percent(undefined).empty());
}

TEST_CASE("columns are aligned by what is shown, empty ones are left out", "[apps]") {
    apps::SummaryTable table({{"name", apps::SummaryTable::Align::left}, {"nothing"}, {"± sd"}});
    CHECK(table.text().empty());
    table.add({"φ", "", "1"});
    table.add({"longer", "", "22222"});
    CHECK(table.text() == "  name     ± sd\n  φ           1\n  longer  22222\n");
    CHECK_THROWS_AS(table.add({"a", "b"}), std::invalid_argument);
}

TEST_CASE("the summary tells what a reader must know", "[apps]") {
    const std::string text = apps::estimate_summary(tests::made_up_estimate(), tests::made_up_context(), "A swing");
    CHECK(text.substr(0, 8) == "A swing\n");
    for (const char* words :
         {"singular: one direction carries no information", "0.3170012", "2.5e-06", "[0.3169962, 0.3170062]",
          "at lower", "c2 lies at its lower bound", "+18.9 %", "+0.000379 %", "+0.48",
          "m is decided by the prior alone", "c2, m cannot be told apart", "+1 : -0.5",
          "36668 autocorrelated records are worth about 30 independent", "from a sandwich", "0.998",
          "period 1: 6, period 2: 9, period 3: none found", "phi 0.002"}) {
        CAPTURE(words);
        CHECK_THAT(text, ContainsSubstring(words));
    }
    // The sd from white noise must not stand anywhere near a parameter whose interval is a sandwich.
    CHECK_THAT(text, !ContainsSubstring("0.0001 "));
    CHECK_THAT(text, !ContainsSubstring("nan"));
    CHECK_THAT(text, !ContainsSubstring("\x1b"));
    std::istringstream lines(text);
    std::string line;
    while (std::getline(lines, line)) {
        CAPTURE(line);
        CHECK(apps::shown_width(line) <= 100);
        CHECK((line.empty() || line.back() != ' '));
    }
}

TEST_CASE("two rms of one record are explained, missing ones left out", "[apps]") {
    auto context = tests::made_up_context();
    auto estimate = tests::made_up_estimate();
    const double rms = estimate.scales[1].rms;
    REQUIRE(estimate.scales[1].group == "series.phi");
    context.predictions = {{"run1", "0", {{"phi", 0.98 * rms}, {"x2", undefined}}, 1.0, true}};
    const std::string text = apps::estimate_summary(estimate, context, "");
    CHECK_THAT(text, ContainsSubstring("fitted to these readings alone") && !ContainsSubstring("x2"));
    context.predictions[0].rms = {{"phi", rms}};
    CHECK_THAT(apps::estimate_summary(estimate, context, ""), !ContainsSubstring("fitted to these readings alone"));
    // Segments count by their readings: together they may have the rms of the estimate.
    context.predictions[0].rms = {{"phi", std::sqrt(0.5) * rms}};
    context.predictions[0].readings = {200};
    context.predictions.push_back({"run1", "1", {{"phi", std::sqrt(2.0) * rms}}, 1.0, true, {100}});
    CHECK_THAT(apps::estimate_summary(estimate, context, ""), !ContainsSubstring("fitted to these readings alone"));
    context.predictions[1].readings = {300};
    CHECK_THAT(apps::estimate_summary(estimate, context, ""), ContainsSubstring("fitted to these readings alone"));
    context.predictions.pop_back();
    context.predictions[0].rms = {{"phi", undefined}};
    CHECK_THAT(apps::estimate_summary(estimate, context, ""),
               ContainsSubstring("cannot be simulated over all of it") && !ContainsSubstring("nan"));
}

TEST_CASE("cycles are summarised by period, missing ones named", "[apps]") {
    orbits::CycleSearch search;
    for (const double multiplier : {-1.7, 18.5}) {
        orbits::Cycle cycle;
        cycle.period = 2;
        cycle.points = Eigen::Matrix2d::Zero();
        cycle.covariance = Eigen::Matrix4d::Identity() * 4e-12;
        cycle.multipliers = {{multiplier, 0.0}, {0.04, 0.0}};
        cycle.recurrences = multiplier > 0.0 ? 5 : 40;
        search.cycles.push_back(cycle);
    }
    search.missing = {3, 5};
    search.remarks = {"no cycle of period 3 was found: of 12 near returns none closed on a cycle"};
    const std::string text = apps::cycles_summary(search);
    CHECK_THAT(text, ContainsSubstring("       2       2       4     5 ... 40"));
    CHECK_THAT(text, ContainsSubstring("1.7 ... 18.5"));
    CHECK_THAT(text, ContainsSubstring("2e-06"));
    CHECK_THAT(text, ContainsSubstring("period 3: none found: of 12 near returns none closed on a cycle\n"));
    CHECK_THAT(text, ContainsSubstring("period 5: none found\n"));
}

TEST_CASE("a prediction tells every rms there is, and no other", "[apps][predict]") {
    apps::Forecast forecast;
    apps::SegmentForecast& one = forecast.segments.emplace_back();
    one.segment = "7";
    one.readings = 40;
    one.duration = 4.0;
    one.beginning = 0.4;
    // x2 has no reading; the sd of the others is not known, so that there is no ratio either.
    one.course = {{"x1", "m", 0.0125, undefined}, {"x2", "m", undefined, undefined}};
    one.ahead = {{"x1", "m", 0.0625, undefined}, {"x2", "m", undefined, undefined}};
    const std::string text = apps::prediction_summary(forecast, "");
    CHECK_THAT(text, ContainsSubstring("x1 0.0125 m") && ContainsSubstring("x1 0.0625 m"));
    CHECK_THAT(text, !ContainsSubstring("x2") && !ContainsSubstring("nan"));
}

}  // namespace
}  // namespace orbid::summary_test
