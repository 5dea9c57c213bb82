// What partial observation can determine: systems whose symmetries are known in closed form.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "identification/problem/problem_residuals.hpp"
#include "identification/strategy/identify.hpp"
#include "identification/structure/structural_check.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace structural_check_test {

using namespace orbid;
using namespace orbid::tests;
using identification::IdentificationProblem;
using identification::StructuralReport;
using identification::UndeterminedDirection;
using Kind = UndeterminedDirection::Kind;

namespace {

using Named = std::vector<std::pair<std::string, double>>;
using Equations = std::vector<std::pair<std::string, std::string>>;

/// A flow, what is read of it, and the values that made the record; `free` are estimated from 7 % off.
struct Setting {
    Equations equations;
    Named parameters;
    std::vector<std::string> free;
    std::vector<double> start;
    std::vector<std::string> observe;
    double step = 0.05;
    std::size_t count = 300;
};

std::shared_ptr<const models::System> system_of(const Setting& setting) {
    models::EquationText text;
    for (const auto& [name, rate] : setting.equations)
        text.coordinates.push_back({name, rate});
    for (const auto& [name, value] : setting.parameters)
        text.parameters.push_back({name, "1", models::any_real, value});
    for (const auto& [name, value] : setting.parameters)
        text.used_outside.push_back(name);
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    for (const auto& problem : problems)
        UNSCOPED_INFO(problem.rule);
    REQUIRE(problems.empty());
    return system;
}

IdentificationProblem problem_of(const Setting& setting) {
    IdentificationProblem problem;
    problem.system = system_of(setting);
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{setting.step, setting.count, 0};
    options.initial = Eigen::Map<const Eigen::VectorXd>(setting.start.data(), std::ssize(setting.start));
    orbits::Series all = orbits::simulate(*problem.system, problem.system->default_parameters(), options).series;
    orbits::Series read = all;
    read.coordinates.clear();
    Eigen::MatrixXd values(std::ssize(setting.observe), all.segments[0].times.size());
    problem.experiments.emplace_back();
    for (const std::string& name : setting.observe) {
        const Eigen::Index index = problem.system->coordinate_index(name);
        values.row(std::ssize(read.coordinates)) = all.segments[0].values.row(index);
        read.coordinates.push_back(all.coordinate(index));
        problem.experiments[0].observe.push_back(index);
    }
    read.segments[0].values = values;
    problem.experiments[0].name = "run";
    problem.experiments[0].series = std::make_shared<const orbits::Series>(read);
    for (const std::string& name : setting.free) {
        const Eigen::Index index = problem.system->parameter_index(name);
        problem.parameters.push_back(
            identification::free_parameter(*problem.system, name, 1.07 * problem.system->default_parameters()[index]));
    }
    problem.series.emplace();
    problem.series->data = {0};
    return problem;
}

StructuralReport report_of(const IdentificationProblem& asked) {
    const IdentificationProblem problem = identification::completed(asked);
    const StructuralReport report =
        structural_report(problem, estimate_setup(problem, identification::fitted_labels(problem)));
    CAPTURE(report.reason);
    CHECK(report.examined);
    return report;
}

Setting lorenz(std::string observed) {
    return {{{"x", "s * (y - x)"}, {"y", "x * (r - z) - y"}, {"z", "x * y - b * z"}},
            {{"s", 10.0}, {"r", 28.0}, {"b", 8.0 / 3.0}},
            {"s", "r", "b"},
            {1.0, 2.0, 20.0},
            {std::move(observed)},
            0.02};
}

/// x' = a y, y' = -b x - d y: read x alone, and (y, a, b) -> (c y, a / c, c b) changes nothing.
Setting oscillator() {
    return {{{"x", "a * y"}, {"y", "-b * x - d * y"}},
            {{"a", 1.5}, {"b", 2.0}, {"d", 0.1}},
            {"a", "b", "d"},
            {1.0, 0.3},
            {"x"}};
}

void check_scaling(const UndeterminedDirection& direction, const Named& powers) {
    CAPTURE(direction.text);
    CHECK(direction.kind == Kind::scaling);
    REQUIRE(direction.unknowns.size() == powers.size());
    for (std::size_t i = 0; i < powers.size(); ++i) {
        CHECK(direction.unknowns[i] == powers[i].first);
        CHECK(direction.components[i] == powers[i].second);
    }
}

}  // namespace

TEST_CASE("one coordinate of Lorenz's or Rossler's flow determines everything", "[identification][structure]") {
    CHECK(report_of(problem_of(lorenz("x"))).directions.empty());
    CHECK(report_of(problem_of(lorenz("x"))).signs.empty());
    const StructuralReport z = report_of(problem_of(lorenz("z")));
    CHECK(z.directions.empty());
    // Its symmetry, which z does not see.
    CHECK(z.signs == std::vector<std::vector<std::string>>{{"x", "y"}});
    const Setting rossler{{{"x", "-y - z"}, {"y", "x + a * y"}, {"z", "b + z * (x - c)"}},
                          {{"a", 0.2}, {"b", 0.2}, {"c", 5.7}},
                          {"a", "b", "c"},
                          {1.0, 2.0, 0.1},
                          {"x"}};
    CHECK(report_of(problem_of(rossler)).directions.empty());
    CHECK(report_of(problem_of(rossler)).signs.empty());
}

TEST_CASE("a hidden coordinate in units of its own is a scaling by name", "[identification][structure]") {
    const StructuralReport report = report_of(problem_of(oscillator()));
    REQUIRE(report.directions.size() == 1);
    check_scaling(report.directions[0], {{"y", 1.0}, {"a", -1.0}, {"b", 1.0}});
    CHECK(report.directions[0].text ==
          "y, a and b can be scaled together: (y, a, b) -> (c y, a / c, c b) changes no reading");
    // The last of a and b is held.
    CHECK(report.directions[0].held == "b");
    CHECK(report.why_held("b") == report.directions[0].text);
    CHECK(report.why_held("a").empty());
}

TEST_CASE("two hidden coordinates can have two scalings, with powers", "[identification][structure]") {
    // y -> c y: a / c^2, g / c. z -> c z: b / c, k c.
    const Setting setting{{{"x", "-x + a * y^2 + b * z"}, {"y", "1.2 * g - y - x * y"}, {"z", "k * x * (2 - x) - z"}},
                          {{"a", 0.7}, {"b", 0.4}, {"g", 1.1}, {"k", 0.9}},
                          {"a", "b", "g", "k"},
                          {0.5, 0.8, 0.3},
                          {"x"}};
    const StructuralReport report = report_of(problem_of(setting));
    REQUIRE(report.directions.size() == 2);
    check_scaling(report.directions[0], {{"z", 1.0}, {"b", -1.0}, {"k", 1.0}});
    check_scaling(report.directions[1], {{"y", 1.0}, {"a", -2.0}, {"g", 1.0}});
    CHECK(report.directions[0].held == "k");
    CHECK(report.directions[1].held == "g");
}

TEST_CASE("a hidden origin is a shift by name", "[identification][structure]") {
    // y -> y + c: p - c, q + 2 c.
    const Setting setting{
        {{"x", "y + p - x^3"}, {"y", "q - 2 * y - x"}}, {{"p", 0.4}, {"q", 0.7}}, {"p", "q"}, {0.5, 0.2}, {"x"}};
    const StructuralReport report = report_of(problem_of(setting));
    REQUIRE(report.directions.size() == 1);
    CHECK(report.directions[0].kind == Kind::shift);
    CHECK(report.directions[0].text ==
          "y, p and q can be shifted together: (y, p, q) -> (y + c, p - c, q + 2 c) changes no reading");
    CHECK(report.directions[0].held == "q");
}

TEST_CASE("parameters that act in one combination, or not at all", "[identification][structure]") {
    // a + b^2 is determined, neither of them; n is in no equation.
    const Setting setting{{{"x", "-(a + b^2) * x"}, {"y", "x - k * y"}},
                          {{"a", 0.4}, {"b", 0.7}, {"k", 0.2}, {"n", 3.0}},
                          {"a", "b", "k", "n"},
                          {1.5, 0.2},
                          {"x", "y"}};
    const StructuralReport report = report_of(problem_of(setting));
    REQUIRE(report.directions.size() == 2);
    CHECK(report.directions[0].kind == Kind::no_effect);
    CHECK(report.directions[0].text == "n has no effect on the readings");
    CHECK(report.directions[1].kind == Kind::combination);
    CHECK(report.directions[1].unknowns == std::vector<std::string>{"a", "b"});
    CHECK(report.directions[1].held == "b");
}

TEST_CASE("a weak effect is no missing one", "[identification][structure]") {
    // z acts on what is read by a part in a million.
    const Setting setting{{{"x", "y"}, {"y", "-w * x + 1e-6 * z"}, {"z", "k * x - z"}},
                          {{"w", 1.7}, {"k", 0.9}},
                          {"w", "k"},
                          {1.0, 0.1, 0.3},
                          {"x"}};
    CHECK(report_of(problem_of(setting)).directions.empty());
}

TEST_CASE("a prior or a given first value is a reading too", "[identification][structure]") {
    IdentificationProblem problem = problem_of(oscillator());
    problem.parameters[1].value.prior = estimator::NormalPrior{2.0, 0.3};
    CHECK(report_of(problem).directions.empty());
    // Bounds, of a uniform density too, are none.
    problem.parameters[1].value.prior = estimator::UniformPrior{0.5, 4.0};
    CHECK(report_of(problem).directions.size() == 1);

    problem = problem_of(oscillator());
    problem.experiments[0].initial_state.resize(2);
    problem.experiments[0].initial_state[1] = {false, 0.3};
    CHECK(report_of(problem).directions.empty());
    // But 0 is 0 in all units.
    problem.experiments[0].initial_state[1] = {false, 0.0};
    const StructuralReport zero = report_of(problem);
    REQUIRE(zero.directions.size() == 1);
    check_scaling(zero.directions[0], {{"y", 1.0}, {"a", -1.0}, {"b", 1.0}});
}

TEST_CASE("a coordinate that never acts on what is measured is refused", "[identification][structure]") {
    Setting setting = oscillator();
    setting.equations.emplace_back("w", "x - w");
    setting.start.push_back(0.5);
    const IdentificationProblem problem = problem_of(setting);
    CHECK_THROWS_WITH(report_of(problem), ContainsSubstring("run: no record determines where w begins") &&
                                              ContainsSubstring("never acts on what is measured") &&
                                              ContainsSubstring("remove it from the model") &&
                                              ContainsSubstring("\"interval\": \"segment\""));
    CHECK_THROWS_AS(identification::identify(problem, {}), orbits::DataError);
    IdentificationProblem given = problem;
    given.experiments[0].initial_state.resize(3);
    given.experiments[0].initial_state[2] = {false, 0.5};
    CHECK(report_of(given).directions.size() == 1);
    setting.observe = {"x", "w"};
    CHECK(report_of(problem_of(setting)).directions.size() == 1);
}

TEST_CASE("a reading that depends on nothing is refused", "[identification][structure]") {
    IdentificationProblem problem = problem_of(oscillator());
    const auto names = models::reading_names(problem.system->coordinates(), problem.system->parameters());
    problem.experiments[0].sensor.type = models::Sensor::Type::function;
    problem.experiments[0].sensor.functions = {{0, models::Expression::parse("2 + 0 * x", names)}};
    CHECK_THROWS_WITH(report_of(problem), ContainsSubstring("run: the reading of x, 2 + 0 * x, depends on no") &&
                                              ContainsSubstring("it determines nothing"));
    // A sensor with a gain of its own: the unit of all coordinates is free.
    problem.experiments[0].sensor.functions = {{0, models::Expression::parse("d * x", names)}};
    CHECK(report_of(problem).directions.size() == 1);
}

TEST_CASE("readings that do not change are refused", "[identification][structure]") {
    IdentificationProblem problem = problem_of(lorenz("x"));
    orbits::Series still = *problem.experiments[0].series;
    still.segments[0].values = Eigen::MatrixXd::Constant(1, still.segments[0].times.size(), 3.0);
    problem.experiments[0].series = std::make_shared<const orbits::Series>(still);
    const IdentificationProblem whole = identification::completed(problem);
    CHECK_THROWS_WITH(structural_report(whole, estimate_setup(whole, identification::fitted_labels(whole))),
                      ContainsSubstring("run: no reading differs from the one before"));
}

TEST_CASE("fewer readings than unknowns are refused with both numbers", "[identification][structure]") {
    Setting setting = lorenz("x");
    setting.count = 6;
    IdentificationProblem problem = problem_of(setting);
    problem.series->interval = 1;
    CHECK_THROWS_WITH(report_of(problem), ContainsSubstring("6 readings for 3 free parameters and 3 initial values") &&
                                              ContainsSubstring("at least 7 are needed"));
    setting.count = 7;
    problem = problem_of(setting);
    problem.series->interval = 1;
    CHECK(report_of(problem).directions.empty());
}

TEST_CASE("what no record determines is held, and the rest is found", "[identification][structure]") {
    IdentificationProblem problem = problem_of(oscillator());
    const auto with_errors = [&] {
        orbits::Series series = *problem.experiments[0].series;
        for (Eigen::Index k = 0; k < series.segments[0].times.size(); ++k)
            series.segments[0].values(0, k) += 1e-3 * std::sin(3.7 * static_cast<double>(k * k));
        return series;
    };
    problem.experiments[0].series = std::make_shared<const orbits::Series>(with_errors());
    const identification::IdentificationResult result = identification::identify(problem, {});
    CHECK(result.estimate.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.estimate.message, ContainsSubstring("b was held at its start: y, a and b can be scaled"));
    REQUIRE(result.structure.directions.size() == 1);
    const auto& parameters = result.estimate.parameters;
    REQUIRE(parameters.size() == 3);
    CHECK(parameters[1].value == 1.07 * 2.0);
    CHECK(std::isnan(parameters[1].sd));
    CHECK(parameters[1].interval_method == estimator::IntervalMethod::fixed);
    // a b = 3 is what the record tells.
    CHECK(parameters[0].sd > 0.0);
    CHECK(std::abs(parameters[0].value - 3.0 / parameters[1].value) < 4.0 * parameters[0].sd);
    CHECK(std::abs(parameters[2].value - 0.1) < 4.0 * parameters[2].sd);
    CHECK(std::isnan(result.estimate.covariance(1, 1)));
    CHECK(std::isfinite(result.estimate.covariance(0, 2)));
}

TEST_CASE("what is not a series of samples alone is not examined", "[identification][structure]") {
    IdentificationProblem problem = problem_of(oscillator());
    problem.series.reset();
    const IdentificationProblem none = identification::completed(problem);
    orbits::Series sections = *problem.experiments[0].series;
    sections.sampling = orbits::Series::Sampling::section;
    IdentificationProblem other = identification::completed(problem_of(oscillator()));
    other.experiments[0].series = std::make_shared<const orbits::Series>(sections);
    const StructuralReport report =
        structural_report(other, estimate_setup(other, identification::fitted_labels(other)));
    CHECK_FALSE(report.examined);
    CHECK(report.reason == "the series are sections");
}

}  // namespace structural_check_test
