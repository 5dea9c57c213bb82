// What `orbid check` finds in the files that a job names, and what it expects of the run.

#include <cmath>
#include <string>

#include "apps/job/reading/job_reader.hpp"
#include "apps/program/check/data_check.hpp"
#include "apps/program/check/work_estimate.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace data_check_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

json swing_job(const Path& table) {
    json job = json::parse(R"({
      "model": { "name": "free_pendulum" },
      "data": { "file": "", "kind": "samples", "columns": { "time": "t", "phi": "angle" }, "observe": ["phi"] },
      "estimate": { "parameters": { "c2": { "start": 1e-3 } }, "residuals": [ { "type": "series", "data": ["data"] } ] } })");
    job["data"]["file"] = table;
    job["data"]["name"] = "data";
    return job;
}

const apps::StageWork& stage(const std::vector<apps::StageWork>& work, const std::string& name) {
    for (const apps::StageWork& one : work)
        if (one.stage == name) return one;
    throw std::invalid_argument("no stage " + name);
}

std::vector<apps::StageWork> work_of(const json& job, int threads = 1) {
    const auto reading = apps::read_job(job.dump(), "job.json");
    if (!reading.job) throw std::invalid_argument(reading.problems.front().rule);
    return apps::estimated_work(*reading.job, apps::check_data(*reading.job), threads);
}

}  // namespace

TEST_CASE("check reads the data as a run does", "[apps][command]") {
    const TemporaryFolder folder;
    const Path table = folder.path() / "swing.csv";
    const Path file = write_job(folder.path() / "job.json", swing_job(table));
    std::string rows = "t,angle\n";
    for (int i = 0; i < 40; ++i)
        rows += std::to_string(0.01 * i) + "," + std::to_string(0.001 * i) + "\n";
    const auto refused = [&](const std::string& text, const std::string& message) {
        write_text(table, text);
        const Outcome check = orbid_with({"check", file});
        CHECK(check.code == 3);
        CHECK_THAT(check.error, ContainsSubstring(message));
        // The run ends with the very same words.
        const Outcome run = orbid_with({"run", file, "--out", folder.path() / "out", "--quiet"});
        CHECK(run.code == 3);
        CHECK(run.error == check.error);
    };
    refused("t,phi\n0,1\n", "angle");
    std::string wrong = rows;
    wrong.replace(wrong.find("0.003000"), 8, "0,03");
    refused(wrong, "swing.csv:5");
    wrong = rows;
    wrong.replace(wrong.find("0.003000"), 8, "x");
    refused(wrong, "is not a number");
    // Three readings for two initial values, a parameter and an error scale.
    refused("t,angle\n0,0.1\n0.01,0.2\n0.02,0.3\n", "readings");

    write_text(table, rows);
    const Outcome good = orbid_with({"check", file, "--threads", "3"});
    CAPTURE(good.error);
    CHECK(good.code == 0);
    CHECK_THAT(good.out, ContainsSubstring("40 points in 1 segment") && ContainsSubstring("with 3 threads"));
    std::filesystem::remove(table);
    CHECK(orbid_with({"check", file}).code == 3);
}

TEST_CASE("the estimate of the work follows the numbers of the job", "[apps][command]") {
    json job = pendulum_job(1 << 20);
    const auto work = work_of(job);
    // 2^20 sections of two doubles.
    CHECK_THAT(stage(work, "simulate").megabytes, WithinRel(16.777216, 1e-12));
    CHECK(stage(work, "orbits").megabytes >= stage(work, "simulate").megabytes);
    CHECK(stage(work, "estimate").seconds > 0.0);
    // Four trajectories, so that more threads than these do not help.
    CHECK_THAT(stage(work_of(job, 4), "simulate").seconds, WithinRel(stage(work, "simulate").seconds / 4.0, 1e-12));
    CHECK(stage(work_of(job, 64), "simulate").seconds == stage(work_of(job, 4), "simulate").seconds);
    job["data"]["simulate"]["sections"] = 1 << 21;
    CHECK_THAT(stage(work_of(job), "simulate").megabytes, WithinRel(2.0 * 16.777216, 1e-12));
    CHECK_THAT(stage(work_of(job), "simulate").seconds, WithinRel(2.0 * stage(work, "simulate").seconds, 1e-2));
    // Errors of readings need the longer search, up to as many points as it is made for.
    job["data"]["simulate"]["sections"] = 1 << 18;
    const double clean = stage(work_of(job), "orbits").seconds;
    job["data"]["simulate"]["noise"] = {{"phi", 1e-3}, {"phi_dot", 1e-3}};
    CHECK(stage(work_of(job), "orbits").seconds > 5.0 * clean);
    job["data"]["simulate"]["sections"] = 1 << 19;
    CHECK(stage(work_of(job), "orbits").seconds < 5.0 * clean);
    CHECK(apps::work_table({}, 4).empty());
}

json equations_job(const std::string& equation) {
    return {{"model", {{"equations", {{"x", "v"}, {"v", equation}}}, {"parameters", {{"k", 1.0}, {"c", 0.1}}}}},
            {"seed", 1},
            {"data",
             {{"name", "run"},
              {"simulate", {{"samples", {{"step", 0.1}, {"count", 2000}}}, {"initial", json::array({{0.5, 0.0}})}}},
              {"observe", {"x"}}}},
            {"estimate",
             {{"parameters", {{"k", {{"start", 1.1}}}, {"c", {{"start", 0.12}}}}},
              {"residuals", json::array({{{"type", "series"}, {"interval", "segment"}}})}}},
            {"output", {{"series", "none"}}}};
}

TEST_CASE("rates are those of the job's own model, and times follow them", "[apps][command]") {
    const auto reading = apps::read_job(equations_job("-c * v - k * x - x^3").dump(), "job.json");
    REQUIRE(reading.job);
    const apps::DataCheck data = apps::check_data(*reading.job);
    const auto rates = apps::measured_rates(*reading.job, data);
    REQUIRE(rates.size() == 1);
    CHECK(rates[0].unknown.empty());
    CHECK(rates[0].value > 0.0);
    CHECK(rates[0].derivatives > 0.0);
    auto twice = rates;
    twice[0].derivatives *= 2.0;
    const double seconds = stage(apps::estimated_work(*reading.job, data, 1, rates), "estimate").seconds;
    CHECK(seconds > 0.0);
    CHECK_THAT(stage(apps::estimated_work(*reading.job, data, 1, twice), "estimate").seconds,
               WithinRel(2.0 * seconds, 1e-12));
}

TEST_CASE("a time that cannot be known is called unknown, with its reason", "[apps][command]") {
    // x'' = x^2 grows without bound before the first hundred samples.
    const auto reading = apps::read_job(equations_job("k * x^2 + 30 * x - c * v").dump(), "job.json");
    REQUIRE(reading.job);
    const apps::DataCheck data = apps::check_data(*reading.job);
    const auto rates = apps::measured_rates(*reading.job, data);
    REQUIRE(rates.size() == 1);
    CHECK_THAT(rates[0].unknown, ContainsSubstring("left the range of finite numbers"));
    const auto work = apps::estimated_work(*reading.job, data, 1, rates);
    CHECK(std::isnan(stage(work, "estimate").seconds));
    CHECK_THAT(apps::work_table(work, 1),
               ContainsSubstring("unknown") && ContainsSubstring("left the range of finite numbers"));
    // Where a branch ends is found by following it.
    const Outcome branch = orbid_with({"check", orbid::tests::source_folder() + "/configs/pendulum_cascade.json"});
    CHECK_THAT(branch.out, ContainsSubstring("found by following it"));
}

TEST_CASE("every example job is checked with its data", "[apps][command]") {
    std::size_t jobs = 0;
    for (const auto& entry : std::filesystem::directory_iterator(orbid::tests::source_folder() + "/configs")) {
        if (entry.path().extension() != ".json") continue;
        CAPTURE(entry.path().string());
        const Outcome check = orbid_with({"check", entry.path()});
        CAPTURE(check.error);
        CHECK(check.code == 0);
        CHECK_THAT(check.out, ContainsSubstring("about") && ContainsSubstring("memory"));
        ++jobs;
    }
    CHECK(jobs >= 18);
}

TEST_CASE("what no record determines is told by check and by the run, and held", "[apps][command][structure]") {
    const TemporaryFolder folder;
    // x'' = -3 x, slightly damped, with errors of 1e-3.
    std::string rows = "t,x\n";
    for (int i = 0; i < 200; ++i)
        rows +=
            std::to_string(0.05 * i) + "," +
            std::to_string(std::exp(-0.0025 * i) * std::cos(std::sqrt(3.0) * 0.05 * i) + 1e-3 * std::sin(9.1 * i * i)) +
            "\n";
    write_text(folder.path() / "x.csv", rows);
    json job = json::parse(R"({
      "model": { "equations": { "x": "a * y", "y": "-b * x - d * y" }, "parameters": { "a": 1.2, "b": 1.8, "d": 0.12 } },
      "data": { "name": "run", "kind": "samples", "columns": { "time": "t", "x": "x" } },
      "estimate": { "parameters": { "a": {}, "b": {}, "d": {} },
                    "residuals": [ { "type": "series", "interval": "segment" } ],
                    "profile": ["a", "b"], "posterior": { "sample": { "draws": 50, "chains": 2 } } } })");
    job["data"]["file"] = folder.path() / "x.csv";
    const Path file = write_job(folder.path() / "job.json", job);
    const std::string words = "y, a and b can be scaled together: (y, a, b) -> (c y, a / c, c b) changes no reading";
    const Outcome check = orbid_with({"check", file});
    CHECK(check.code == 0);
    CHECK_THAT(check.out, ContainsSubstring("note       " + words + ": b is held at its start"));

    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", file, "--out", out, "--threads", "2"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    CHECK_THAT(run.error, ContainsSubstring(words));
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    CHECK_THAT(result["message"].get<std::string>(), ContainsSubstring("b was held at its start: " + words));
    const json& b = result["parameters"]["b"];
    CHECK(b["value"] == 1.8);
    CHECK(b["sd"].is_null());
    CHECK(b["interval95"].is_null());
    CHECK(b["interval_method"] == "fixed");
    CHECK(b["held"] == words);
    CHECK_FALSE(result["parameters"]["a"].contains("held"));
    CHECK_THAT(result["parameters"]["a"]["value"].get<double>(), WithinRel(3.0 / 1.8, 0.01));
    const json& structural = result["identifiability"]["structural"];
    CHECK(structural["examined"] == true);
    REQUIRE(structural["directions"].size() == 1);
    CHECK(structural["directions"][0]["kind"] == "scaling");
    CHECK(structural["directions"][0]["unknowns"] == json({"y", "a", "b"}));
    CHECK(structural["directions"][0]["components"] == json({1.0, -1.0, 1.0}));
    CHECK(structural["directions"][0]["held"] == "b");
    // Nothing is drawn or profiled of what is held.
    CHECK(result["profile"].contains("a"));
    CHECK_FALSE(result["profile"].contains("b"));
    CHECK_THAT(content(out).at("posterior.csv"), ContainsSubstring("chain,draw,a,d,"));
    CHECK_THAT(content(out).at("report.html"), ContainsSubstring("Determined by no record"));

    job["model"]["equations"]["w"] = "x - w";
    const Path uncoupled = write_job(folder.path() / "uncoupled.json", job);
    const Outcome refused = orbid_with({"check", uncoupled});
    CHECK(refused.code == 3);
    CHECK_THAT(refused.error, ContainsSubstring("run: no record determines where w begins"));
    const Outcome not_run = orbid_with({"run", uncoupled, "--out", folder.path() / "other", "--quiet"});
    CHECK(not_run.code == 3);
    CHECK(not_run.error == refused.error);
}

}  // namespace data_check_test
