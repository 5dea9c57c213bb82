// Identification as one call: known parameters are found, an observer stops it, and what was kept gives the same bytes.

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
#include "tests/identification/henon_problem.hpp"

namespace identify_test {

using namespace orbid;
using namespace orbid::tests;
using estimator::EstimateStatus;
using identification::IdentificationProblem;
using identification::IdentificationResult;
using identification::Stage;
using identification::StageValue;

namespace {

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

/// Says stop from the nth question on, which may come from several threads.
class CountingObserver : public identification::Observer {
public:
    explicit CountingObserver(int most) : most_(most) {}
    [[nodiscard]] bool stopped() const override { return ++asked_ > most_; }
    [[nodiscard]] int asked() const { return asked_; }

private:
    const int most_;
    mutable std::atomic<int> asked_ = 0;
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

TEST_CASE("several starts go with predictions and with nodes", "[identification]") {
    const IdentificationProblem problem = henon_problem();
    const IdentificationResult one = identification::identify(problem);
    identification::Options options;
    options.starts = 4;
    const IdentificationResult several = identification::identify(problem, options);
    CAPTURE(several.estimate.message);
    CHECK(several.estimate.status == EstimateStatus::converged);
    REQUIRE(several.runs.size() == 4);
    // The first start is the problem's own, as the prediction before it has moved it. Courses that fold within the
    // errors of readings have minima beside each other, which nothing that is reported tells apart.
    constexpr double near_sds = 0.1, near_objective = 0.1;
    REQUIRE(several.runs[0].optimum >= 0);
    const auto own = static_cast<std::size_t>(several.runs[0].optimum);
    CHECK(several.optima.at(own).objective - several.optima[0].objective < near_objective);
    REQUIRE(several.estimate.parameters.size() == one.estimate.parameters.size());
    for (std::size_t i = 0; i < one.estimate.parameters.size(); ++i) {
        const estimator::Estimated& same = one.estimate.parameters[i];
        CAPTURE(same.name);
        CHECK(std::abs(several.estimate.parameters[i].value - same.value) < near_sds * same.sd);
        CHECK(several.estimate.parameters[i].start == same.start);
    }
}

TEST_CASE("stopped at any question, an identification ends by name", "[identification]") {
    const IdentificationProblem problem = henon_problem();
    identification::Options options;
    options.starts = 2;
    CountingObserver never(std::numeric_limits<int>::max());
    const IdentificationResult whole = identification::identify(problem, options, never);
    REQUIRE(whole.estimate.status == EstimateStatus::converged);
    REQUIRE(never.asked() > 10);
    constexpr int stops = 12;
    for (int k = 0; k < stops; ++k) {
        CountingObserver observer(never.asked() * k / stops);
        const IdentificationResult result = identification::identify(problem, options, observer);
        CAPTURE(k, never.asked(), observer.asked(), result.estimate.message);
        CHECK(result.estimate.parameters.size() == (result.stages.empty() ? 0U : 2U));
        // The last questions come when all is found.
        if (result.estimate.status == EstimateStatus::converged && k > stops / 2)
            CHECK(result.estimate.objective == whole.estimate.objective);
        else
            CHECK(result.estimate.status == EstimateStatus::interrupted);
    }
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

}  // namespace identify_test
