// Identification as one call: known parameters are found, an observer stops it, what was kept gives the same bytes, and
// what contradicts itself is refused.

#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <oneapi/tbb/task_arena.h>

#include "identification/stages/stage_value.hpp"
#include "identification/stages/strategy_stage.hpp"
#include "identification/strategy/identify.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace identify_test {

using namespace orbid;
using namespace orbid::tests;
using estimator::EstimateStatus;
using identification::IdentificationProblem;
using identification::IdentificationResult;
using identification::Stage;
using identification::StageValue;

namespace {

/// 800 iterates of the Henon map (a = 1.4, b = 0.3) with errors of 1e-3; both parameters start off by 10 %.
IdentificationProblem henon_problem() {
    IdentificationProblem problem;
    problem.system = models::make_system("henon");
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{800, 100, {}, 0.0};
    experiment.trajectories = 2;
    experiment.initial = Eigen::MatrixXd{{0.1, 0.2}, {0.1, 0.1}};
    experiment.noise = Eigen::Vector2d(1e-3, 1e-3);
    experiment.seed = 3;
    problem.experiments.emplace_back();
    problem.experiments.back().name = "run1";
    problem.experiments.back().series = std::make_shared<const orbits::Series>(
        orbits::simulate(*problem.system, Eigen::Vector2d(1.4, 0.3), experiment).series);
    problem.experiments.back().follows_model = true;
    problem.parameters = {identification::free_parameter(*problem.system, "a", 1.54),
                          identification::free_parameter(*problem.system, "b", 0.27)};
    return problem;
}

/// Same value to the bit in all that an estimate says in numbers.
void check_same(const estimator::Estimate& one, const estimator::Estimate& other) {
    CHECK(one.status == other.status);
    CHECK(one.message == other.message);
    CHECK(one.objective == other.objective);
    CHECK(one.log_likelihood == other.log_likelihood);
    CHECK(one.iterations == other.iterations);
    CHECK(one.evaluations == other.evaluations);
    REQUIRE(one.parameters.size() == other.parameters.size());
    for (std::size_t i = 0; i < one.parameters.size(); ++i) {
        CAPTURE(one.parameters[i].name);
        CHECK(one.parameters[i].value == other.parameters[i].value);
        CHECK(one.parameters[i].sd == other.parameters[i].sd);
        CHECK(one.parameters[i].lower95 == other.parameters[i].lower95);
        CHECK(one.parameters[i].start == other.parameters[i].start);
    }
    CHECK((one.covariance == other.covariance));
    CHECK((one.latents == other.latents));
    REQUIRE(one.scales.size() == other.scales.size());
    for (std::size_t i = 0; i < one.scales.size(); ++i)
        CHECK(one.scales[i].value == other.scales[i].value);
}

/// Says stop once a stage has ended, or once a minimisation has taken a step in a stage.
class StoppingObserver : public identification::Observer {
public:
    [[nodiscard]] bool stopped() const override { return stopped_; }
    void begin(const std::string& step, double /*total*/, const std::string& /*unit*/) override { step_ = step; }
    void at(double /*done*/, const std::string& /*note*/) override {
        if (step_ == stop_within) stopped_ = true;
    }
    void stage_ended(const IdentificationResult& so_far) override {
        if (so_far.stages.size() == stop_after) stopped_ = true;
    }
    void stop() { stopped_ = true; }

    std::size_t stop_after = 0;  ///< stages; 0: never
    std::string stop_within;

private:
    std::string step_;
    std::atomic<bool> stopped_ = false;
};

/// Keeps stages and matching in memory, and counts what is computed.
class KeepingObserver : public identification::Observer {
public:
    using Observer::keep;
    using Observer::recall;
    [[nodiscard]] bool recall(const std::string& name, StageValue& value) override {
        const auto found = stages.find(name);
        if (found == stages.end()) return false;
        value = found->second;
        return true;
    }
    void keep(const std::string& name, StageValue& value) override { stages[name] = value; }
    void recalled(const std::string& /*step*/, const std::string& /*outcome*/) override { ++recalled_steps; }
    void at(double /*done*/, const std::string& /*note*/) override { ++steps; }

    std::map<std::string, StageValue> stages;
    int recalled_steps = 0;
    std::atomic<int> steps = 0;
};

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

TEST_CASE("known parameters are found from a record and equations alone", "[identification]") {
    const IdentificationResult result = identification::identify(henon_problem());
    const estimator::Estimate& estimate = result.estimate;
    CAPTURE(estimate.message);
    CHECK(estimate.status == EstimateStatus::converged);
    REQUIRE(estimate.parameters.size() == 2);
    const std::map<std::string, double> truth{{"a", 1.4}, {"b", 0.3}};
    for (const estimator::Estimated& parameter : estimate.parameters) {
        CAPTURE(parameter.name, parameter.value, parameter.sd);
        CHECK(std::abs(parameter.value - truth.at(parameter.name)) < 4.0 * parameter.sd);
        // 4 000 iterates gave 5.1e-6; a fifth of them less than ten times that.
        CHECK(parameter.sd < 5e-5);
    }
    REQUIRE(result.stages.size() == 2);
    CHECK(result.stages[0].stage == "prediction");
    CHECK(result.stages[1].stage == "series");
    CHECK_FALSE(result.stages[0].chosen);
    CHECK(result.stages[1].chosen);
    CHECK(estimate.iterations == result.stages[0].iterations + result.stages[1].iterations);
    // 800 readings of each: the sd of their error is known to 1 / sqrt(2 * 800) = 2.5 %; four of that.
    int readings = 0;
    for (const estimator::EstimatedScale& scale : estimate.scales) {
        if (scale.group != "series.x" && scale.group != "series.y") continue;
        ++readings;
        CHECK_THAT(scale.value, WithinRel(1e-3, 0.1));
    }
    CHECK(readings == 2);
    REQUIRE(result.matching.size() == 1);
    CHECK(result.matching[0].experiment == "run1");
    CHECK(result.matching[0].intervals == 798);
    CHECK(result.matching[0].large == 0);
    CHECK(result.best != nullptr);
}

namespace {

/// The same with cycles of its record, which are found when they are asked for.
IdentificationProblem searched_problem(int& searches) {
    IdentificationProblem problem = henon_problem();
    problem.measured.experiment = 0;
    problem.cycles.emplace().sensor = problem.experiments[0].sensor;
    problem.series.emplace().interval = identification::SeriesChoice::automatic_interval;
    problem.cycles_if_needed = true;
    problem.measured.find = [&searches, section = problem.experiments[0].series](auto& measured) {
        ++searches;
        measured.section = section;
        measured.options.periods = {1, 2};
        measured.search = orbits::find_cycles(*section, measured.options);
    };
    return problem;
}

std::vector<std::string> stage_names(const IdentificationResult& result) {
    std::vector<std::string> names;
    for (const auto& stage : result.stages)
        names.push_back(stage.stage);
    return names;
}

}  // namespace

TEST_CASE("cycles are left out where the series is explained", "[identification]") {
    int searches = 0;
    const IdentificationResult result = identification::identify(searched_problem(searches));
    const IdentificationResult series = identification::identify(henon_problem());
    CHECK(searches == 0);
    CHECK(stage_names(result) == std::vector<std::string>{"prediction", "series", "cycles", "harvest", "series"});
    check_same(result.estimate, series.estimate);
    REQUIRE(result.stages.size() == 5);
    CHECK(result.stages[1].chosen);
    for (std::size_t i = 2; i < 5; ++i) {
        CHECK(result.stages[i].needless);
        CHECK_FALSE(result.stages[i].status.has_value());
        CHECK_THAT(result.stages[i].message, ContainsSubstring("not needed"));
    }
    CHECK(result.cycles.empty());
}

TEST_CASE("where the series is not explained, the strategy goes on from the prediction", "[identification]") {
    // b is held at a value that no reading agrees with: whatever a, residuals are a function of the state.
    int searches = 0;
    IdentificationProblem problem = searched_problem(searches);
    problem.values = Eigen::Vector2d(1.4, 0.32);
    problem.parameters.pop_back();
    problem.experiments[0].follows_model = false;
    const IdentificationResult result = identification::identify(problem);
    CHECK(searches == 1);
    CHECK(stage_names(result) == std::vector<std::string>{"prediction", "series", "cycles", "harvest", "series"});
    for (const auto& stage : result.stages)
        CHECK_FALSE(stage.needless);

    // As with cycles before the series.
    using Kind = Stage::Kind;
    using identification::ResidualType;
    identification::Options options;
    options.strategy = {{Kind::prediction, {}},
                        {Kind::residuals, {ResidualType::cycles}},
                        {Kind::harvest, {ResidualType::cycles}},
                        {Kind::residuals, {ResidualType::series}}};
    const IdentificationResult before = identification::identify(problem, options);
    CHECK(result.estimate.status == before.estimate.status);
    REQUIRE(before.stages.size() == 4);
    REQUIRE(result.stages.size() == 5);
    for (std::size_t i = 1; i < 3; ++i) {
        CHECK(result.stages[i + 1].status == before.stages[i].status);
        CHECK((result.stages[i + 1].objective == before.stages[i].objective || std::isnan(before.stages[i].objective)));
    }
    CHECK(result.estimate.objective <= before.estimate.objective);
}

TEST_CASE("one thread finds the same to the bit", "[identification][threads]") {
    const IdentificationProblem problem = henon_problem();
    const IdentificationResult all = identification::identify(problem);
    IdentificationResult alone;
    tbb::task_arena(1).execute([&] { alone = identification::identify(problem); });
    check_same(all.estimate, alone.estimate);
    CHECK(all.matching.at(0).shift == alone.matching.at(0).shift);
}

TEST_CASE("stopped between stages, the estimate is that of the stage before", "[identification]") {
    StoppingObserver observer;
    observer.stop_after = 1;
    const IdentificationResult result = identification::identify(henon_problem(), {}, observer);
    CHECK(result.estimate.status == EstimateStatus::interrupted);
    CHECK_THAT(result.estimate.message, ContainsSubstring("the estimate is that of the stage prediction"));
    REQUIRE(result.stages.size() == 1);
    CHECK(result.stages[0].status == EstimateStatus::converged);
    REQUIRE(result.estimate.parameters.size() == 2);
    for (std::size_t i = 0; i < 2; ++i)
        CHECK(result.estimate.parameters[i].value == result.stages[0].parameters[i].value);
    // Off by 10 % at the start.
    CHECK(std::abs(result.estimate.parameters[0].value / 1.4 - 1.0) < 0.01);
}

TEST_CASE("stopped within a stage, the estimate is the best of the stages that succeeded", "[identification]") {
    StoppingObserver observer;
    observer.stop_within = "series";
    const IdentificationResult result = identification::identify(henon_problem(), {}, observer);
    CHECK(result.estimate.status == EstimateStatus::interrupted);
    REQUIRE(result.stages.size() == 2);
    CHECK(result.stages[1].status == EstimateStatus::interrupted);
    CHECK(result.stages[0].chosen);
    CHECK_THAT(result.estimate.message, ContainsSubstring("of the stage prediction; series interrupted"));
    for (std::size_t i = 0; i < 2; ++i)
        CHECK(result.estimate.parameters.at(i).value == result.stages[0].parameters[i].value);
}

TEST_CASE("stopped before it begins, there is no estimate", "[identification]") {
    StoppingObserver observer;
    observer.stop();
    const IdentificationResult result = identification::identify(henon_problem(), {}, observer);
    CHECK(result.estimate.status == EstimateStatus::interrupted);
    CHECK(result.estimate.message == "interrupted before the estimate");
    CHECK(result.estimate.parameters.empty());
    CHECK(result.stages.empty());
    CHECK(result.best == nullptr);
}

TEST_CASE("a stage handed back gives the same to the bit", "[identification]") {
    const IdentificationProblem problem = henon_problem();
    KeepingObserver first;
    const IdentificationResult whole = identification::identify(problem, {}, first);
    CHECK(first.recalled_steps == 0);
    REQUIRE(first.stages.size() == 2);
    CHECK(first.stages.count("stage 0") == 1);
    CHECK(first.stages.count("stage 1") == 1);

    SECTION("all stages") {
        KeepingObserver second;
        second.stages = first.stages;
        const IdentificationResult again = identification::identify(problem, {}, second);
        CHECK(second.recalled_steps == 2);
        CHECK(second.steps < first.steps);
        check_same(whole.estimate, again.estimate);
        CHECK(whole.matching.at(0).shift == again.matching.at(0).shift);
    }
    SECTION("the first one") {
        KeepingObserver second;
        second.stages["stage 0"] = first.stages["stage 0"];
        const IdentificationResult again = identification::identify(problem, {}, second);
        CHECK(second.recalled_steps == 1);
        check_same(whole.estimate, again.estimate);
        CHECK(whole.matching.at(0).shift == again.matching.at(0).shift);
    }
}

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

}  // namespace identify_test
