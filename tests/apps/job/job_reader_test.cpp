#include "apps/job/reading/job_reader.hpp"

#include <filesystem>
#include <string>
#include <vector>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/starting/model_listing.hpp"
#include "apps/program/starting/starting_job.hpp"
#include "models/catalogue/registry.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/catch.hpp"

namespace job_reader_test {

using namespace orbid;
using namespace orbid::apps;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;

namespace {

/// A good job in which one text is replaced by another.
std::string job_with(const std::string& from = "", const std::string& to = "") {
    std::string text = R"({
  "model": { "name": "parametric_pendulum", "variant": "crank", "parameters": { "m": 0.0858, "l": 0.317 } },
  "seed": 1,
  "section": { "phase": 0.0 },
  "data": { "name": "run1",
    "simulate": { "sections": 1024, "trajectories": 2, "transient": 300, "initial": "random" },
    "sensor": { "type": "state" }, "observe": ["phi", "phi_dot"] },
  "orbits": { "method": "local_maps", "periods": [1, 2], "box": 0.01, "neighbours": 32, "local_map": "quadratic" },
  "estimate": {
    "parameters": {
      "l": { "start": 0.377, "scale": "log", "bounds": [0.05, 5.0] },
      "k2": { "start": 6.48e-4 } },
    "derived": { "k2_over_m": "k2 / m" },
    "residuals": [ { "type": "cycles", "weights": "covariance", "multipliers": false } ],
    "variance": "restricted", "strategy": ["cycles"], "multi_start": { "starts": 1 }, "posterior": { "sample": 0 } },
  "reference": { "l": 0.317, "k2_over_m": 5.65e-3 }
})";
    if (!from.empty()) {
        const auto at = text.find(from);
        REQUIRE(at != std::string::npos);
        text.replace(at, from.size(), to);
    }
    return text;
}

struct Wrong {
    std::string from;
    std::string to;
    std::string message;  ///< beginning of the only problem
};

void check_each(const std::vector<Wrong>& table) {
    for (const Wrong& wrong : table) {
        CAPTURE(wrong.from, wrong.to);
        const auto found = problems(job_with(wrong.from, wrong.to));
        CAPTURE(found);
        REQUIRE(found.size() == 1);
        CHECK_THAT(found[0], Catch::Matchers::StartsWith(wrong.message));
    }
}

}  // namespace

TEST_CASE("a good job is read into plain values", "[apps][job]") {
    const auto reading = read_job(job_with(), job_folder / "job.json");
    REQUIRE(problems(job_with()).empty());
    CHECK(reading.exit_code() == 0);
    const Job& job = *reading.job;
    CHECK(job.model.variant == "crank");
    CHECK(job.model.values[0] == 0.0858);
    CHECK(job.model.values[5] == 9.81);  // left out: the model's default
    CHECK(job.data[0].simulation->sections == 1024);
    CHECK(job.orbits->search.symmetry_signs == std::vector<double>{-1.0, -1.0});
    REQUIRE(job.estimate->parameters.size() == 2);
    CHECK(job.estimate->parameters[0].value.scale == estimator::Scale::log);
    CHECK(job.estimate->parameters[1].value.scale == estimator::Scale::linear);  // >= 0, not > 0
    CHECK(job.estimate->parameters[1].value.lower == 0.0);
    CHECK(job.estimate->cycles->periods == std::vector<int>{1, 2});
    CHECK(job.estimate->cycles->errors.size() == 2);
    CHECK(job.estimate->derived[0].expression.value(job.model.values) == 4.85e-4 / 0.0858);
}

TEST_CASE("what is wrong is named with place and rule", "[apps][job]") {
    check_each({
        {"\"trajectories\"", "\"trajectorys\"",
         "job.json:6: /data/simulate/trajectorys: unknown key; did you mean \"trajectories\"?"},
        {"\"section\":", "\"sektion\":", "job.json:4: /sektion: unknown key; did you mean \"section\"?"},
        {"\"seed\": 1", "\"seed\": \"one\"", "job.json:3: /seed: must be a whole number, not \"one\""},
        {"\"seed\": 1", "\"seed\": 1.5", "job.json:3: /seed: must be a whole number"},
        {"\"seed\": 1,", "\"seed\": 1, \"seed\": 2,", "job.json:3: /seed: duplicate key, first given in line 3"},
        {"\"l\": 0.317 }", "\"l\": -0.317 }", "job.json:2: /model/parameters/l: l (length, m) must be > 0, not -0.317"},
        {"\"l\": 0.317 }", "\"len\": 1 }",
         "job.json:2: /model/parameters/len: the model parametric_pendulum has no parameter \"len\""},
        {"\"start\": 0.377", "\"start\": 6",
         "job.json:11: /estimate/parameters/l/start: start 6 of l lies outside its bounds [0.05, 5]"},
        {"\"k2\": { \"start\": 6.48e-4 }", "\"k2\": { \"start\": 0, \"scale\": \"log\" }",
         "job.json:12: /estimate/parameters/k2/start: start 0 of k2 has no logarithm: use \"scale\": \"linear\""},
        {"[0.05, 5.0]", "[5, 0.05]", "job.json:11: /estimate/parameters/l/bounds: lower bound 5 must be below"},
        {"\"k2\": {", "\"k4\": {", "job.json:12: /estimate/parameters/k4: the model parametric_pendulum has no"},
        {"[1, 2]", "[]", "job.json:8: /orbits/periods: must not be empty"},
        {"[1, 2]", "[1, 1]", "job.json:8: /orbits/periods/1: 1 is listed twice"},
        {"\"box\": 0.01", "\"minimum_recurrences\": 0", "job.json:8: /orbits/minimum_recurrences: must be a whole"},
        {"\"box\": 0.01", "\"invariants\": 1", "job.json:8: /orbits/invariants: must be true, false or {"},
        {"\"quadratic\"", "\"septic\"",
         "job.json:8: /orbits/local_map: unknown value \"septic\"; did you mean \"sextic\"?"},
        {"\"box\": 0.01", "\"box\": 0.6", "job.json:8: /orbits/box: must be > 0 and < 0.5, not 0.6"},
        {"\"k2 / m\"", "\"k2 / q\"", "job.json:13: /estimate/derived/k2_over_m: character 6 of \"k2 / q\""},
        {"\"l\": 0.317, \"k2", "\"length\": 0.317, \"k2", "job.json:16: /reference/length: \"length\" is neither"},
        {"[\"phi\", \"phi_dot\"]", "[\"phi\", \"phi_dot\", \"psi\"]",
         "job.json:7: /data/observe/2: the model parametric_pendulum has"},
        {"\"crank\"", "\"crak\"", "job.json:2: /model/variant: unknown value \"crak\"; did you mean \"crank\"?"},
        {"\"name\": \"run1\"", "\"name\": \"1st\"", "job.json:5: /data/name: must be a name: letters"},
        {"\"random\"", "[[0, 1]]", "job.json:6: /data/simulate/initial: must hold one state per trajectory: 2, not 1"},
    });
}

TEST_CASE("the way of telling the map is chosen by name", "[apps][job]") {
    using Method = orbits::CycleSearchOptions::Method;
    const std::vector<std::pair<std::string, Method>> methods{{"auto", Method::automatic},
                                                              {"local_maps", Method::local_maps},
                                                              {"patch_map", Method::spline_map},
                                                              {"closest_return", Method::closest_return}};
    for (const auto& [name, method] : methods) {
        CAPTURE(name);
        const auto reading = read_job(
            job_with(
                "\"local_maps\", \"periods\": [1, 2], \"box\": 0.01, \"neighbours\": 32, \"local_map\": \"quadratic\"",
                "\"" + name + "\", \"periods\": [1, 2]"),
            job_folder / "job.json");
        REQUIRE(reading.job);
        CHECK(reading.job->orbits->search.method == method);
        const std::string written = job_text(*reading.job, job_folder);
        CHECK_THAT(written, ContainsSubstring("\"method\": \"" + name + "\""));
        const auto again = read_job(written, job_folder / "job.json");
        REQUIRE(again.job);
        CHECK(again.job->orbits->search.method == method);
    }
    tests::check_only(job_with("\"local_maps\"", "\"closest_return\""),
                      "job.json:8: /orbits/local_map: with \"method\": \"closest_return\" maps are linear");
    tests::check_only(job_with("\"local_maps\"", "\"closest\""), "/orbits/method: unknown value \"closest\"");
}

TEST_CASE("reserved names and values are refused by name", "[apps][job]") {
    const std::vector<std::pair<std::string, std::string>> later{{"\"phase\": 0.0", "\"coordinate\": \"phi\""}};
    for (const auto& [from, to] : later) {
        CAPTURE(to);
        const auto reading = read_job(job_with(from, to), job_folder / "job.json");
        REQUIRE_FALSE(reading.problems.empty());
        CHECK_THAT(message(reading.problems[0], "job.json"), ContainsSubstring("not in this version"));
        CHECK(reading.exit_code() == 2);
    }
}

TEST_CASE("all problems are reported at once, by line", "[apps][job]") {
    std::string text = job_with("\"seed\": 1", "\"seed\": -1, \"sede\": 2");
    text.replace(text.find("\"box\": 0.01"), 11, "\"box\": true");
    text.replace(text.find("\"start\": 6.48e-4"), 16, "\"start\": -1");
    const auto found = problems(text);
    CAPTURE(found);
    REQUIRE(found.size() == 4);
    CHECK_THAT(found[0], ContainsSubstring("/seed"));
    CHECK_THAT(found[1], ContainsSubstring("/sede"));
    CHECK_THAT(found[2], ContainsSubstring("/orbits/box: must be a number, not true"));
    CHECK_THAT(found[3], ContainsSubstring("must be >= 0"));
}

TEST_CASE("a missing data file is a problem of the data", "[apps][job]") {
    const auto reading = read_job(R"({ "model": { "name": "free_pendulum" },
      "data": { "file": "no_such.csv", "kind": "samples", "columns": { "time": "t", "phi": "phi" } },
      "estimate": { "parameters": {}, "residuals": [ { "type": "series" } ] } })",
                                  job_folder / "job.json");
    REQUIRE(reading.problems.size() == 1);
    CHECK_THAT(message(reading.problems[0], "job.json"),
               ContainsSubstring("job.json:2:25: /data/file: the file") && ContainsSubstring("does not exist"));
    CHECK(reading.exit_code() == 3);
    CHECK(read_job_file(job_folder / "no_such_job.json").exit_code() == 2);
}

TEST_CASE("every job in configs is read, and its complete form reads back", "[apps][job]") {
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(job_folder)) {
        if (entry.path().extension() != ".json") continue;
        ++count;
        CAPTURE(entry.path());
        const auto reading = read_job_file(entry.path());
        REQUIRE(reading.job);
        const auto out = job_folder / "some" / "where";
        const std::string text = job_text(*reading.job, out);
        const auto again = read_job(text, out / "job.json");
        REQUIRE(again.job);
        CHECK(job_text(*again.job, out) == text);
        CHECK(again.job->model.values == reading.job->model.values);
        CHECK(again.job->data.size() == reading.job->data.size());
        REQUIRE(bool(again.job->estimate) == bool(reading.job->estimate));
        if (!reading.job->estimate) continue;
        REQUIRE(again.job->estimate->parameters.size() == reading.job->estimate->parameters.size());
        for (std::size_t i = 0; i < reading.job->estimate->parameters.size(); ++i) {
            const auto& a = reading.job->estimate->parameters[i].value;
            const auto& b = again.job->estimate->parameters[i].value;
            CHECK(a.start == b.start);
            CHECK(a.lower == b.lower);
            CHECK(a.upper == b.upper);
            CHECK(a.scale == b.scale);
        }
        if (!reading.job->data.empty() && reading.job->data[0].file)
            CHECK(again.job->data[0].file->paths == reading.job->data[0].file->paths);
    }
    CHECK(count >= 4);
}

TEST_CASE("every model has starting jobs that pass the check", "[apps][job]") {
    for (const std::string& model : starting_models()) {
        for (const std::string& task : starting_tasks()) {
            CAPTURE(model, task);
            const models::Kind kind = model == "equations" ? models::Kind::forced : models::make_system(model)->kind();
            if ((task == "cycles" && kind == models::Kind::autonomous) ||
                ((task == "series" || task == "waveform") && kind == models::Kind::map)) {
                CHECK_THROWS_WITH(starting_job(model, task), ContainsSubstring("not in this version"));
                continue;
            }
            // "search" reads what "continuation" reads; the simulations for their starts take their time.
            if (task == "search" && kind == models::Kind::forced) continue;
            CHECK(problems(starting_job(model, task)).empty());
        }
    }
}

}  // namespace job_reader_test
