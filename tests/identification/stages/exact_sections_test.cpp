// Measured sections in noise: exact matching where the model explains them, errors of matching where it does not.

#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "identification/problem/estimated_values.hpp"
#include "identification/strategy/identify.hpp"
#include "models/catalogue/registry.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace exact_sections_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

struct Unknown {
    std::string name;
    double value, start;
};
const std::vector<Unknown> unknown{
    {"delta", 0.25, 0.27}, {"alpha", -1.0, -1.05}, {"beta", 1.0, 0.95}, {"gamma", 0.3, 0.31}};

/// Sections of Duffing's oscillator with a further force `quadratic` x^2, as if they were measured.
/// @param error  of the readings, over their ranges.
identification::IdentificationProblem measured(double quadratic, double error) {
    models::EquationText text;
    text.coordinates = {{"x", "x_dot"},
                        {"x_dot", "gamma * cos(tau) - delta * x_dot - alpha * x - beta * x^3 - quadratic * x^2"}};
    for (const Unknown& one : unknown)
        text.parameters.push_back({one.name, "1", models::Domain::real, one.value});
    const auto model = models::make_system("duffing");
    text.parameters.push_back(
        {"omega", "rad/s", models::positive, model->default_parameters()[model->parameter_index("omega")]});
    text.parameters.push_back({"quadratic", "1", models::Domain::real, quadratic});
    text.forcing = {"tau", "omega"};
    std::vector<models::EquationProblem> wrong;
    const auto record = models::system_from_text(text, wrong);
    REQUIRE(wrong.empty());
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{500, 50, {}, 0.0};
    experiment.initial = Eigen::Vector2d(0.5, 0.0);
    experiment.noise = error * Eigen::Vector2d(2.9, 1.5);
    experiment.seed = 11;
    identification::IdentificationProblem problem;
    problem.system = model;
    problem.experiments.emplace_back();
    problem.experiments[0].name = "run";
    problem.experiments[0].series = std::make_shared<const orbits::Series>(
        orbits::simulate(*record, record->default_parameters(), experiment).series);
    for (const Unknown& one : unknown)
        problem.parameters.push_back(identification::free_parameter(*problem.system, one.name, one.start));
    problem.series.emplace();
    problem.series->data = {0};
    problem.series->interval = 1;
    return problem;
}

struct Log final : identification::Observer {
    void detail(const std::string& line) override { said += line + "\n"; }
    void remark(const std::string& line) override { said += line + "\n"; }
    std::string said;
};

}  // namespace

TEST_CASE("measured sections in noise are matched exactly if the model explains them", "[identification][series]") {
    Log log;
    const auto found = identification::identify(measured(0.0, 5e-3), identification::Options{}, log);
    CHECK_THAT(log.said, ContainsSubstring("nodes are matched exactly: errors of readings alone explain the sections"));
    REQUIRE(found.estimate.status == estimator::EstimateStatus::converged);
    const auto* link = identification::scale_of(found.estimate, "series.matching.x");
    REQUIRE(link != nullptr);
    CHECK_FALSE(link->estimated);
    for (std::size_t i = 0; i < unknown.size(); ++i) {
        const estimator::Estimated& one = found.estimate.parameters[i];
        CAPTURE(one.name, one.value, one.sd);
        CHECK(std::abs(one.value - unknown[i].value) < 4.0 * one.sd);
        CHECK(one.start == unknown[i].start);
    }
}

TEST_CASE("sections that the model does not explain keep errors of matching", "[identification][series]") {
    Log log;
    const auto found = identification::identify(measured(0.05, 5e-3), identification::Options{}, log);
    CHECK_THAT(log.said, ContainsSubstring("sections matched exactly: "));
    CHECK_THAT(log.said, !ContainsSubstring("alone explain"));
    const auto* link = identification::scale_of(found.estimate, "series.matching.x");
    REQUIRE(link != nullptr);
    CHECK(link->estimated);
}

}  // namespace exact_sections_test
