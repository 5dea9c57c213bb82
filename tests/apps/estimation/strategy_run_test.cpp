// Strategies as they run: stages one after the other, what the result tells of them, other models beside the job's.

#include <cmath>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "apps/results/strategy_results.hpp"
#include "identification/stages/strategy_run.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace strategy_run_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// Iterates of the Henon map, both parameters off by 10 %.
json henon_job(int sections, double noise) {
    json job = json::parse(R"({
      "model": { "name": "henon", "parameters": { "a": 1.4, "b": 0.3 } },
      "seed": 3,
      "data": { "name": "run1", "simulate": { "trajectories": 2, "initial": [[0.1, 0.1], [0.2, 0.1]], "transient": 100 } },
      "estimate": { "parameters": { "a": { "start": 1.54 }, "b": { "start": 0.27 } } },
      "reference": { "a": 1.4, "b": 0.3 },
      "output": { "series": "csv" } })");
    job["data"]["simulate"]["sections"] = sections;
    if (noise > 0.0) job["data"]["simulate"]["noise"] = {{"x", noise}, {"y", noise}};
    return job;
}

/// Sections of the pendulum's transients, read by the encoder.
json experiment_job(int sections) {
    json job = json::parse(R"({
      "model": { "name": "parametric_pendulum", "variant": "crank", "parameters": { "k1": 1e-3 } },
      "seed": 1,
      "data": { "name": "run1", "simulate": { "sections": 0, "trajectories": 2, "transient": 20 },
        "sensor": { "type": "angle_difference", "angle": "phi", "rate": "phi_dot", "delay": 0.01508,
                    "step": 1.5339807878856412e-3, "rounding": "nearest" } },
      "estimate": { "parameters": { "l": { "start": 0.4 }, "k1": { "start": 2e-3 }, "k2": { "start": 2e-4 }, "k3": { "start": 4e-4 } },
                    "residuals": [ { "type": "series" } ], "strategy": "auto" } })");
    job["data"]["simulate"]["sections"] = sections;
    return job;
}

double in_sds(const json& parameter, double truth) {
    return std::abs(parameter["value"].get<double>() - truth) / parameter["sd"].get<double>();
}

estimator::Estimate estimate_of(double value, estimator::EstimateStatus status) {
    estimator::Estimate estimate;
    estimate.status = status;
    estimate.parameters.emplace_back();
    estimate.parameters.back().name = "a";
    estimate.parameters.back().value = value;
    return estimate;
}

}  // namespace

TEST_CASE("stages run one after the other, and the result tells of each", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    json job = henon_job(800, 1e-3);
    job["estimate"]["strategy"] = "auto";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    REQUIRE(result["stages"].size() == 2);
    const std::vector<std::string> names{"prediction", "series"};
    for (std::size_t i = 0; i < names.size(); ++i) {
        const json& stage = result["stages"][i];
        CAPTURE(stage);
        CHECK(stage["stage"] == names[i]);
        CHECK(stage["chosen"] == (i == 1));
        CHECK(stage["status"] == "converged");
        CHECK(std::abs(stage["parameters"]["a"]["value"].get<double>() / 1.4 - 1.0) < 0.01);
        CHECK(stage["parameters"]["a"]["start"] == 1.54);
        CHECK(stage["iterations"].get<int>() > 0);
    }
    const json& last = result["parameters"];
    for (const auto& [name, truth] : std::map<std::string, double>{{"a", 1.4}, {"b", 0.3}}) {
        CAPTURE(name, last[name]);
        CHECK(in_sds(last[name], truth) < 4.0);
        // 4 000 iterates gave 5.1e-6; a fifth of them less than ten times that.
        CHECK(last[name]["sd"].get<double>() < 5e-5);
        CHECK(last[name]["value"] == result["stages"][1]["parameters"][name]["value"]);
    }
    const json& matching = result["matching"][0];
    CHECK(matching["interval"] == 1);
    CHECK(matching["intervals"] == 798);
    CHECK(matching["large_defects"] == 0);
    REQUIRE(matching["looser_shift_in_sds"].contains("a"));
    CHECK(std::abs(matching["looser_shift_in_sds"]["a"].get<double>()) < 4.0);
    CHECK_THAT(run.out, ContainsSubstring("Stages") && ContainsSubstring("the result") &&
                            ContainsSubstring("Matching of nodes"));

    // One row per reading.
    std::istringstream residuals(apps::read_whole_file(out / "residuals.csv"));
    int rows = -1;
    for (std::string line; std::getline(residuals, line);)
        ++rows;
    CHECK(rows == 2 * 800);

    // The complete job repeats the run, with another number of threads, to the byte.
    const Path again = folder.path() / "again";
    REQUIRE(orbid_with({"run", out / "job.json", "--out", again, "--threads", "1"}).code == 0);
    CHECK((apps::read_whole_file(out / "result.json") == apps::read_whole_file(again / "result.json")));
    CHECK((apps::read_whole_file(out / "residuals.csv") == apps::read_whole_file(again / "residuals.csv")));
}

TEST_CASE("cycles come before what they point to", "[apps][run]") {
    const TemporaryFolder folder;
    json job = henon_job(8000, 0.0);
    job["orbits"] = {{"periods", {1, 2, 4}}, {"method", "local_maps"}};
    job["estimate"]["residuals"] = {{{"type", "cycles"}}};
    job["estimate"]["strategy"] = {"cycles", "harvest"};
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out, "--quiet"});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    REQUIRE(result["stages"].size() == 2);
    CHECK(result["stages"][0]["status"] == "converged");
    // All there are were found at once.
    CHECK(result["stages"][0]["chosen"] == true);
    CHECK(result["stages"][1]["status"] == "skipped");
    CHECK_THAT(result["message"].get<std::string>(),
               ContainsSubstring("the estimate is that of the stage cycles; harvest skipped: no further cycle"));
    CHECK(std::abs(result["parameters"]["a"]["value"].get<double>() - 1.4) < 1e-9);
}

TEST_CASE("a later stage that fails loses nothing, and is told", "[apps][run]") {
    using estimator::EstimateStatus;
    identification::StrategyRun strategy;
    strategy.best.emplace();
    strategy.best->estimate = estimate_of(2.0, EstimateStatus::converged);
    strategy.stages.resize(2);
    strategy.stages[0].stage = "cycles";
    strategy.stages[0].status = estimator::EstimateStatus::converged;
    strategy.stages[0].chosen = true;
    strategy.stages[1].stage = "series";
    strategy.stages[1].status = estimator::EstimateStatus::failed;
    strategy.stages[1].message = "no step helps";
    strategy.last = EstimateStatus::failed;
    strategy.iterations = 7;

    estimator::Estimate estimate = identification::strategy_estimate(strategy, false);
    CHECK(estimate.status == EstimateStatus::failed);
    CHECK(estimate.parameters.at(0).value == 2.0);
    CHECK(estimate.iterations == 7);
    CHECK(estimate.message == "the estimate is that of the stage cycles; series failed: no step helps");

    // Interrupted: the same, with that status.
    CHECK(identification::strategy_estimate(strategy, true).status == EstimateStatus::interrupted);
    // A stage that had nothing to do changes nothing but the message.
    strategy.stages[1].status.reset();
    strategy.last = EstimateStatus::converged;
    CHECK(identification::strategy_estimate(strategy, false).status == EstimateStatus::converged);
    CHECK_THAT(identification::strategy_estimate(strategy, false).message,
               ContainsSubstring("series skipped: no step helps"));
    // Before anything has run.
    CHECK(identification::strategy_estimate({}, true).status == EstimateStatus::interrupted);
    CHECK(identification::strategy_estimate({}, true).message == "interrupted before the estimate");
}

TEST_CASE("the true model is told from its misprint", "[apps][run]") {
    const TemporaryFolder folder;
    json job = experiment_job(200);
    job["estimate"]["criticism"] = {{"variants", {"crank_as_printed"}}};
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out, "--quiet"});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    const std::map<std::string, double> truth{{"l", 0.317}, {"k1", 1e-3}, {"k2", 4.85e-4}, {"k3", 1.9e-4}};
    for (const auto& [name, value] : truth) {
        CAPTURE(name, result["parameters"][name]);
        CHECK(in_sds(result["parameters"][name], value) < 4.0);
    }
    const json& criticism = result["criticism"];
    CAPTURE(criticism);
    CHECK(criticism["model"] == "variant crank");
    CHECK(criticism["stage"] == "series");
    REQUIRE(criticism["alternatives"].size() == 1);
    const json& other = criticism["alternatives"][0];
    CHECK(other["model"] == "variant crank_as_printed");
    CHECK(other["objective_difference"].get<double>() > 5.0);
    // Only where the wrong model's fit is a proper one; otherwise it is said why not.
    if (other["ln_bayes_factor"]["value"].is_number()) {
        CHECK(other["ln_bayes_factor"]["value"].get<double>() > 5.0);
        CHECK(other["verdict"] == "very strongly supported: the job's model");
    } else {
        CHECK_FALSE(other["ln_bayes_factor"]["reason"].get<std::string>().empty());
    }
    CHECK_THAT(run.out, ContainsSubstring("Against other models, on the stage series"));
}

TEST_CASE("Bayes factors in words", "[apps]") {
    CHECK(apps::in_words(0.5) == "the data hardly tell them apart");
    CHECK(apps::in_words(-0.99) == "the data hardly tell them apart");
    CHECK(apps::in_words(1.0) == "positively supported: the job's model");
    CHECK(apps::in_words(-4.0) == "strongly supported: this one");
    CHECK(apps::in_words(5.0) == "very strongly supported: the job's model");
}

}  // namespace strategy_run_test
