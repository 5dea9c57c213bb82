// Starts of series of which little is read, each against the values that made the record.
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "identification/strategy/identify.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace series_start_test {

using namespace orbid;
using namespace orbid::tests;
using estimator::EstimateStatus;
using identification::IdentificationProblem;
using identification::IdentificationResult;

namespace {

using Named = std::vector<std::pair<std::string, double>>;

/// A flow and the record that is made of it: its first coordinate, with errors of 1 % of its sd.
struct Flow {
    std::vector<std::pair<std::string, std::string>> equations;
    Named truth;
    std::vector<double> offs;  ///< start over truth, per parameter
    std::vector<double> first;
    double step;
    std::size_t count = 1000;
    std::size_t transient = 2000;
};

std::shared_ptr<const models::System> system_of(const Flow& flow) {
    models::EquationText text;
    for (const auto& [name, rate] : flow.equations)
        text.coordinates.push_back({name, rate});
    for (const auto& [name, value] : flow.truth)
        text.parameters.push_back({name, "1", models::any_real, value});
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    return system;
}

orbits::Series record_of(const models::System& system, const Flow& flow) {
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{flow.step, flow.count, flow.transient};
    options.initial = Eigen::Map<const Eigen::VectorXd>(flow.first.data(), std::ssize(flow.first));
    orbits::Series series = orbits::simulate(system, system.default_parameters(), options).series;
    const Eigen::RowVectorXd x = series.segments[0].values.row(0);
    options.noise = Eigen::VectorXd::Zero(system.dimension());
    options.noise[0] = 0.01 * std::sqrt((x.array() - x.mean()).square().mean());
    options.seed = 5;
    series = orbits::simulate(system, system.default_parameters(), options).series;
    series.coordinates.resize(1);
    series.segments[0].values = series.segments[0].values.row(0).eval();
    return series;
}

/// @param model  that is fitted; the parameters of the same name begin off the truth.
IdentificationProblem problem_of(std::shared_ptr<const models::System> model, const Flow& flow, orbits::Series series) {
    IdentificationProblem problem;
    problem.system = std::move(model);
    problem.experiments.emplace_back();
    problem.experiments[0].series = std::make_shared<const orbits::Series>(std::move(series));
    for (std::size_t i = 0; i < flow.truth.size(); ++i)
        if (problem.system->parameter_index(flow.truth[i].first) >= 0)
            problem.parameters.push_back(identification::free_parameter(*problem.system, flow.truth[i].first,
                                                                        flow.offs[i] * flow.truth[i].second));
    problem.series.emplace();
    problem.series->data = {0};
    problem.series->interval = identification::SeriesChoice::automatic_interval;
    return problem;
}

IdentificationResult found_from_x(const Flow& flow) {
    const auto system = system_of(flow);
    return identification::identify(problem_of(system, flow, record_of(*system, flow)), identification::Options{});
}

void check_truth(const IdentificationResult& result, const Flow& flow, double within) {
    CHECK(result.estimate.status == EstimateStatus::converged);
    REQUIRE(result.estimate.parameters.size() == flow.truth.size());
    for (std::size_t i = 0; i < flow.truth.size(); ++i) {
        const estimator::Estimated& one = result.estimate.parameters[i];
        const double truth = flow.truth[i].second;
        CAPTURE(one.name, one.value, one.sd);
        CHECK(std::abs(one.value - truth) < 4.0 * one.sd);
        CHECK(std::abs(one.value - truth) < within * std::abs(truth));
    }
    // The model is the one of the record, and its intervals meet.
    REQUIRE(result.matching.size() == 1);
    CHECK(result.matching[0].large == 0);
}

/// x' feels y and z by their product alone: a start with both at 0 is on an invariant plane.
Flow product_flow() {
    return {{{"x", "-(a * b) / (a + b) * x - y * z + c"}, {"y", "a * y + x * z"}, {"z", "b * z + x * y"}},
            {{"a", -10.0}, {"b", -4.0}, {"c", 18.1}},
            {1.3, 1.3, 0.7},
            {0.5, 0.6, 0.7},
            0.0092};
}

}  // namespace

TEST_CASE("one coordinate of four finds the others and the parameters", "[identification][series]") {
    // Stenflo 1996: Lorenz's equations with rotation; three of four coordinates are hidden.
    const Flow stenflo{
        {{"x", "a * (y - x) + d * w"}, {"y", "c * x - x * z - y"}, {"z", "x * y - b * z"}, {"w", "-x - a * w"}},
        {{"a", 2.0}, {"b", 0.7}, {"c", 26.0}, {"d", 1.5}},
        {0.7, 0.7, 1.3, 0.7},
        {1.0, 2.0, 20.0, 1.0},
        0.039};
    check_truth(found_from_x(stenflo), stenflo, 0.05);
}

TEST_CASE("hidden coordinates do not begin on an invariant plane", "[identification][series]") {
    check_truth(found_from_x(product_flow()), product_flow(), 0.02);
}

TEST_CASE("a sign that nothing tells is that of the start", "[identification][series]") {
    // Rossler's equations with c = k^2.
    const Flow flow{{{"x", "-y - z"}, {"y", "x + a * y"}, {"z", "b + z * (x - k^2)"}},
                    {{"a", 0.2}, {"b", 0.2}, {"k", -2.3874673}},
                    {1.3, 0.7, 0.7},
                    {1.0, 2.0, 0.1},
                    0.06};
    const IdentificationResult result = found_from_x(flow);
    check_truth(result, flow, 0.05);
}

TEST_CASE("a joint prior is the only one of its parameters, in searches too", "[identification][series]") {
    const Flow flow{
        {{"x", "v"}, {"v", "-k * x - c * v"}}, {{"k", 4.0}, {"c", 0.1}}, {1.2, 0.8}, {2.0, 0.0}, 0.1, 200, 0};
    const auto system = system_of(flow);
    IdentificationProblem problem = problem_of(system, flow, record_of(*system, flow));
    problem.joint_priors = {{{"k", "c"}, Eigen::Vector2d(4.0, 0.1), Eigen::Vector2d(16.0, 0.01).asDiagonal()}};
    check_truth(identification::identify(problem, identification::Options{}), flow, 0.05);
}

TEST_CASE("a model that misses something is not matched exactly", "[identification][series]") {
    // What is fitted has no cubic damping.
    const Flow flow{{{"x", "v"}, {"v", "-k * x - c * v - 0.4 * v^3"}},
                    {{"k", 4.0}, {"c", 0.05}},
                    {1.2, 0.8},
                    {2.0, 0.0},
                    0.03,
                    600,
                    0};
    const auto real = system_of(flow);
    Flow fitted = flow;
    fitted.equations[1].second = "-k * x - c * v";
    const auto result = identification::identify(problem_of(system_of(fitted), flow, record_of(*real, flow)),
                                                 identification::Options{});
    REQUIRE(result.matching.size() == 1);
    double links = 0.0;
    for (const auto& scale : result.estimate.scales)
        if (scale.group == "series.matching.v") {
            CHECK(scale.estimated);
            links = scale.value;
        }
    CHECK(links > 1e-3);
}

TEST_CASE("a search gives the same bytes again", "[identification][series]") {
    const IdentificationResult a = found_from_x(product_flow()), b = found_from_x(product_flow());
    for (std::size_t i = 0; i < a.estimate.parameters.size(); ++i)
        CHECK(a.estimate.parameters[i].value == b.estimate.parameters[i].value);
}

}  // namespace series_start_test
