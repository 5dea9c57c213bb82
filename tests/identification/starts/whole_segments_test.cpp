// Growth of errors along a segment, against the closed form of linear equations; series that get nodes by it.
#include "identification/starts/whole_segments.hpp"

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/strategy/identify.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace whole_segments_test {

using namespace orbid;
using namespace orbid::tests;
using identification::IdentificationProblem;

namespace {

constexpr double step = 0.05;
constexpr std::size_t count = 200;

/// x' of one coordinate with a parameter "a".
std::shared_ptr<const models::System> system_of(const std::string& rate, double a) {
    models::EquationText text;
    text.coordinates.push_back({"x", rate});
    text.parameters.push_back({"a", "1", models::any_real, a});
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    return system;
}

/// Exact readings of all coordinates at the system's own parameters, from `first`.
orbits::Series record_of(const models::System& system, const std::vector<double>& first, std::size_t readings = count) {
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{step, readings, 0};
    options.initial = Eigen::Map<const Eigen::VectorXd>(first.data(), std::ssize(first));
    return orbits::simulate(system, system.default_parameters(), options).series;
}

/// Over whole segments unless errors grow.
IdentificationProblem problem_of(std::shared_ptr<const models::System> system, orbits::Series series,
                                 const std::vector<std::string>& free) {
    IdentificationProblem problem;
    problem.system = std::move(system);
    problem.experiments.emplace_back();
    problem.experiments[0].series = std::make_shared<const orbits::Series>(std::move(series));
    for (const std::string& name : free) {
        const auto index = problem.system->parameter_index(name);
        problem.parameters.push_back(
            identification::free_parameter(*problem.system, name, problem.system->default_parameters()[index]));
    }
    problem.series.emplace();
    problem.series->unless_errors_grow = true;
    return identification::completed(problem);
}

double growth_of(const IdentificationProblem& problem) {
    auto setup = identification::estimate_setup(problem, identification::fitted_labels(problem));
    identification::ProblemResiduals residuals;
    add_series(problem, setup, residuals);
    return identification::error_growth(*residuals.series.at(0), setup.start());
}

/// Keeps what is remarked, and may stop when nodes are to be tried.
struct Listener : identification::Observer {
    bool stops = false;
    std::string said;
    [[nodiscard]] bool stopped() const override { return stops && said.find("once more with nodes") != said.npos; }
    void remark(const std::string& line) override { said += line + "\n"; }
};

identification::Options one_series() {
    identification::Options options;
    options.strategy = {{identification::Stage::Kind::residuals, {identification::ResidualType::series}}};
    return options;
}

}  // namespace

TEST_CASE("growth of errors along a segment is that of the linear equations", "[identification][series]") {
    // At rest on an unstable state: errors grow by exp(a t), from the end of the first tenth to that of the last.
    const double a = 0.7;
    const double expected = std::exp(a * step * static_cast<double>(count - count / 10));
    const auto unstable = system_of("a * (x - 1)", a);
    const IdentificationProblem problem = problem_of(unstable, record_of(*unstable, {1.0}), {"a"});
    CHECK_THAT(growth_of(problem), WithinRel(expected, 1e-6));

    // The record grows as its errors do: nothing grows in its size. Twenty readings are needed.
    const auto growing = system_of("a * x", a);
    const IdentificationProblem same = problem_of(growing, record_of(*growing, {1.0}), {"a"});
    CHECK(growth_of(same) < 2.0);
    const IdentificationProblem few = problem_of(unstable, record_of(*unstable, {1.0}, 19), {"a"});
    CHECK(growth_of(few) == 0.0);

    // Errors that die out.
    const auto stable = system_of("a * (x - 1)", -a);
    CHECK(growth_of(problem_of(stable, record_of(*stable, {1.5}), {"a"})) < 1.0);
}

TEST_CASE("a series whose errors grow a thousandfold gets nodes where it asks for them", "[identification][series]") {
    struct Row {
        double a;
        bool asks, divided;
    };
    // exp(9 a): a thousandfold at a = 0.7675.
    const Row row = GENERATE(Row{0.75, true, false}, Row{0.78, true, true}, Row{0.78, false, false});
    CAPTURE(row.a, row.asks);
    const auto system = system_of("a * (x - 1)", row.a);
    IdentificationProblem problem = problem_of(system, record_of(*system, {1.0}), {"a"});
    problem.series->unless_errors_grow = row.asks;
    const std::string found = identification::divide_where_errors_grow(problem);
    CHECK(problem.series->interval.has_value() == row.divided);
    CHECK(found.empty() == !row.divided);
    if (row.divided) CHECK_THAT(found, ContainsSubstring("grow 1e+03 times along a segment"));
}

TEST_CASE("a model that leaves the record unexplained is tried with nodes, unless stopped",
          "[identification][series]") {
    // Decay cannot follow a swing; neither can it with nodes.
    const auto decay = system_of("-a * x", 1.0);
    orbits::Series swing = record_of(*decay, {1.0});
    for (Eigen::Index k = 0; k < swing.segments[0].values.cols(); ++k)
        swing.segments[0].values(0, k) = std::sin(3.0 * step * static_cast<double>(k));
    const IdentificationProblem problem = problem_of(decay, std::move(swing), {"a"});
    Listener listener;
    listener.stops = GENERATE(false, true);
    CAPTURE(listener.stops);
    const auto result = identification::identify(problem, one_series(), listener);
    CAPTURE(result.estimate.message, listener.said);
    CHECK_THAT(listener.said, ContainsSubstring("% of the spread of the readings is left"));
    CHECK((listener.said.find("nodes explain it no better") == listener.said.npos) == listener.stops);
    CHECK((result.estimate.status == estimator::EstimateStatus::interrupted) == listener.stops);
}

TEST_CASE("a fit over whole segments is left where errors grow on its way, and ended where nodes fail too",
          "[identification][series]") {
    models::EquationText text;
    text.coordinates = {{"x", "10 * (y - x)"}, {"y", "r * x - y - x * z"}, {"z", "x * y - 8 / 3 * z"}};
    text.parameters.push_back({"r", "1", models::any_real, 21.0});  // no chaos
    std::vector<models::EquationProblem> problems;
    const auto lorenz = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    // Of the size of Lorenz' attractor, but no course of it.
    constexpr std::size_t readings = 60;
    orbits::Series noise = record_of(*lorenz, {1.0, 1.0, 20.0}, readings);
    for (std::size_t k = 0; k < readings; ++k)
        noise.segments[0].times[k] = 0.25 * static_cast<double>(k);
    estimator::RandomStream random(5, estimator::RandomPurpose::reading_noise, 0);
    for (auto column : noise.segments[0].values.colwise())
        column << 8.0 * random.normal(), 9.0 * random.normal(), 24.0 + 8.0 * random.normal();
    IdentificationProblem problem = problem_of(lorenz, std::move(noise), {"r"});
    problem.parameters[0].value.prior = estimator::NormalPrior{28.0, 0.01};  // where the motion is chaotic
    Listener listener;
    const auto result = identification::identify(problem, one_series(), listener);
    CAPTURE(result.estimate.message, listener.said);
    CHECK_THAT(listener.said, ContainsSubstring("not explained (data: errors of the first state grow"));
    CHECK_THAT(listener.said, ContainsSubstring("once more, to the end"));
    // Nobody has stopped it.
    CHECK(result.estimate.status != estimator::EstimateStatus::interrupted);
    CHECK_THAT(result.estimate.parameters.at(0).value, WithinAbs(28.0, 0.1));
}

}  // namespace whole_segments_test
