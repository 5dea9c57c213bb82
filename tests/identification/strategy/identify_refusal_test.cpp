// What contradicts itself is refused by name, value and rule; parameters take the bounds of their domain.

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include "identification/strategy/identify.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "tests/catch.hpp"
#include "tests/identification/henon_problem.hpp"

namespace identify_refusal_test {

using namespace orbid;
using namespace orbid::tests;
using identification::IdentificationProblem;
using identification::Stage;

namespace {

/// What a call is refused with; empty: it is not.
template <class Exception>
std::string refusal(const std::function<void()>& call) {
    try {
        call();
    } catch (const Exception& error) {
        return error.what();
    }
    return {};
}

std::string refused(const std::function<void(IdentificationProblem&, identification::Options&)>& change) {
    IdentificationProblem problem = henon_problem();
    identification::Options options;
    change(problem, options);
    return refusal<std::invalid_argument>([&] { (void)identification::identify(problem, options); });
}

}  // namespace

TEST_CASE("options out of their range are refused by name, value and rule", "[identification]") {
    using P = IdentificationProblem;
    using O = identification::Options;
    CHECK(refused([](P&, O& o) { o.step_tolerance = 0.0; }) == "step_tolerance 0: must be > 0");
    CHECK(refused([](P&, O& o) { o.step_tolerance = std::nan(""); }) == "step_tolerance nan: must be > 0");
    CHECK(refused([](P&, O& o) { o.starts = 0; }) == "starts 0: must be >= 1");
    CHECK(refused([](P&, O& o) { o.comparison.held_out = 0.6; }) == "held_out 0.6: must be in [0, 0.5]");
}

TEST_CASE("a strategy that the problem cannot serve is refused", "[identification]") {
    using P = IdentificationProblem;
    using O = identification::Options;
    using Kind = Stage::Kind;
    using identification::ResidualType;
    const Stage series{Kind::residuals, {ResidualType::series}};
    CHECK(refused([&](P&, O& o) {
              o.strategy = {series, {Kind::prediction, {}}};
          }) == "strategy: the prediction gives a start: it must be the first stage");
    CHECK(refused([&](P&, O& o) {
              o.strategy = {{Kind::residuals, {ResidualType::cycles}}, series};
          }) == "strategy: stage cycles: the problem does not use such data");
    CHECK(refused([&](P&, O& o) {
              o.strategy = {series, {Kind::harvest, {ResidualType::cycles}}};
          }) == "strategy: stage harvest: the problem does not use such data");
    CHECK(refused([&](P&, O& o) {
              o.strategy = {{Kind::residuals, {ResidualType::waveform}}};
          }) == "strategy: stage waveform: the problem does not use such data");
    CHECK(refused([&](P&, O& o) { o.strategy = {{Kind::residuals, {}}}; }) == "strategy: a stage names no residuals");
    CHECK(refused([&](P&, O& o) {
              o.strategy = {{Kind::residuals, {ResidualType::series}, true}};
          }) == "strategy: stage series: is run if needed, so a stage series must come before it");
}

TEST_CASE("a problem that contradicts itself is refused", "[identification]") {
    using P = IdentificationProblem;
    using O = identification::Options;
    CHECK(refused([](P& p, O&) { p.system = nullptr; }) == "a problem needs a system");
    CHECK(refused([](P& p, O&) { p.experiments.clear(); }) ==
          "there is nothing to estimate from: no cycles and no experiment");
    CHECK(refused([](P& p, O&) { p.values = Eigen::Vector3d(1.4, 0.3, 0.0); }) ==
          "3 values for 2 parameters of the model henon");
    CHECK(refused([](P& p, O&) { p.parameters[0].parameter = 2; }) == "parameter 2: the model henon has 2");
    CHECK(refused([](P& p, O&) { p.experiments[0].observe = {2}; }) ==
          "experiment run1: observed coordinate 2: must be in [0, 2)");
    CHECK(refused([](P& p, O&) { p.series.emplace().data = {1}; }) == "experiment 1: there are 1");
    const auto henon = models::make_system("henon");
    CHECK(refusal<std::invalid_argument>([&] { (void)identification::free_parameter(*henon, "c", 1.0); }) ==
          "model henon: has no parameter c");

    IdentificationProblem problem = henon_problem();
    problem.experiments[0].predict = {"nowhere"};
    CHECK(refusal<orbits::DataError>([&] { (void)identification::identify(problem); }) ==
          "run1: there is no segment \"nowhere\"");
}

TEST_CASE("a parameter has the scale and bounds of its domain", "[identification]") {
    const auto duffing = models::make_system("duffing");
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const auto delta = identification::free_parameter(*duffing, "delta", 0.2).value;
    CHECK(delta.scale == estimator::Scale::linear);
    CHECK(delta.lower == 0.0);
    const auto alpha = identification::free_parameter(*duffing, "alpha", -0.9).value;
    CHECK(alpha.lower == -infinity);
    CHECK(alpha.upper == infinity);
    auto omega = identification::free_parameter(*duffing, "omega", 1.1);
    CHECK(omega.parameter == 4);
    CHECK(omega.value.unit == "rad/s");
    CHECK(omega.value.scale == estimator::Scale::log);
    CHECK(omega.value.lower == 0.0);
    // 0 is no frequency: on a linear scale a bound, which may be reached, lies above it.
    omega.value.scale = estimator::Scale::linear;
    identification::set_default_bounds(duffing->parameters()[4], omega.value);
    CHECK(omega.value.lower > 0.0);
    CHECK(omega.value.lower < 1e-6);
}

}  // namespace identify_refusal_test
