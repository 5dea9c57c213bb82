#include <map>
#include <string>

#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace job_equations_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::json;
using tests::problems;

namespace {

/// A job whose model is written in it; the second line holds the equations.
std::string job_with(const std::string& from = "", const std::string& to = "") {
    std::string text = R"json({ "model": {
  "equations": { "x": "v", "v": "b * cos(tau) - k * x - c * sign(v)" },
  "parameters": { "k": { "value": 4, "unit": "1/s^2", "domain": "positive" }, "c": 0.5, "b": 0.9, "omega": 1.5 },
  "forcing_phase": { "name": "tau", "frequency": "omega" } },
  "data": { "simulate": { "sections": 64, "trajectories": 2 } } })json";
    if (!from.empty()) {
        const auto at = text.find(from);
        REQUIRE(at != std::string::npos);
        text.replace(at, from.size(), to);
    }
    return text;
}

}  // namespace

TEST_CASE("a job with equations is read, and written so that it repeats itself", "[apps][job][equations]") {
    std::string text = job_with("\"forcing_phase\"", R"("angles": ["x"], "units": { "v": "rad/s" }, "kind": "flow",
      "switching": ["v"], "symmetry": { "signs": { "x": 1 } }, "compile": false, "name": "bench", "forcing_phase")");
    const auto reading = read_job(text, job_folder / "job.json");
    for (const Problem& problem : reading.problems)
        UNSCOPED_INFO(message(problem, "job.json"));
    REQUIRE(reading.job);
    const ModelJob& model = reading.job->model;
    REQUIRE(model.system);
    CHECK(model.name == "bench");
    CHECK(model.compile == CompileChoice::never);
    CHECK(model.system->kind() == models::Kind::forced);
    CHECK(model.system->coordinates()[0].angle);
    CHECK(model.system->coordinates()[0].unit == "rad");
    CHECK(model.system->parameters()[0].unit == "1/s^2");
    CHECK(model.values == Eigen::Vector4d(4.0, 0.5, 0.9, 1.5));
    const std::string written = job_text(*reading.job, job_folder);
    const auto again = read_job(written, job_folder / "job.json");
    REQUIRE(again.job);
    CHECK(job_text(*again.job, job_folder) == written);
    // The order of the state outlives a program that sorts keys.
    text = job_with("{ \"x\": \"v\", \"v\": \"b", "{ \"z\": \"v\", \"v\": \"b");
    text.replace(text.find("k * x"), 5, "k * z");
    const auto other = read_job(text, job_folder / "job.json");
    REQUIRE(other.job);
    const auto sorted = read_job(json::parse(job_text(*other.job, job_folder)).dump(), job_folder / "job.json");
    REQUIRE(sorted.job);
    CHECK(sorted.job->model.system->coordinates()[0].name == "z");
}

TEST_CASE("errors in equations point into the formula", "[apps][job][equations]") {
    // Line 2; the formula of v begins in column 34.
    const auto reading = read_job(job_with("k * x", "k x"), job_folder / "job.json");
    REQUIRE(reading.problems.size() == 1);
    CHECK(reading.problems[0].pointer == "/model/equations/v");
    CHECK(reading.problems[0].place.line == 2);
    CHECK(reading.problems[0].place.column == 34 + 17);
    CHECK_THAT(reading.problems[0].rule, ContainsSubstring("character 18") && ContainsSubstring("*"));
    check_only(job_with("k * x", "q * x"), "/model/equations/v: character 16");
    check_only(job_with("\"b\": 0.9", "\"b\": 0.9, \"d\": 1"),
               "/model/parameters/d: the parameter d occurs in no formula");
    check_only(job_with("\"b\": 0.9", "\"b\": true"), "/model/parameters/b: must be a number or {");
    check_only(job_with("\"value\": 4", "\"value\": -4"), "/model/parameters/k: k must be > 0, not -4");
    check_only(job_with("\"frequency\": \"omega\"", "\"frequency\": \"o\""),
               "/model/forcing_phase: the frequency \"o\"");
    check_only(job_with("\"forcing_phase\"", "\"angles\": [\"y\"], \"forcing_phase\""),
               "/model/angles/0: \"y\" is no coordinate");
    check_only(job_with("\"forcing_phase\"", "\"angels\": [\"x\"], \"forcing_phase\""),
               "/model/angels: unknown key; did you mean \"angles\"?");
    check_only(job_with("\"forcing_phase\"", "\"switching\": [\"x\"], \"forcing_phase\""), "/model/switching/0");
    check_only(job_with("\"forcing_phase\"", "\"name\": \"lorenz\", \"forcing_phase\""),
               "/model/name: \"lorenz\" is a model of orbid");
    check_only(job_with("\"forcing_phase\"", "\"compile\": 1, \"forcing_phase\""),
               "/model/compile: must be true, false or \"auto\"");
    check_only(job_with("\"forcing_phase\"", "\"coordinates\": [\"x\"], \"forcing_phase\""),
               "/model/coordinates: must list every name");
    // All at once.
    std::string two = job_with("k * x", "k * y");
    two.replace(two.find("\"x\": \"v\""), 8, "\"x\": \"w\"");
    CHECK(problems(two).size() == 2);
}

TEST_CASE("a job with equations estimates what the registered model does", "[apps][run][equations]") {
    const tests::TemporaryFolder folder;
    std::string text = apps::read_whole_file(orbid::tests::source_folder() + "/configs/lorenz.json");
    const std::string model = R"("model": { "name": "lorenz",)";
    const auto at = text.find(model);
    REQUIRE(at != std::string::npos);
    text.replace(at, model.size(), R"json("model": { "equations": { "x": "sigma * (y - x)", "y": "x * (rho - z) - y",
        "z": "x * y - beta * z" }, "compile": false,)json");
    const auto job = tests::write_text(folder.path() / "equations.json", text);
    const auto run = tests::orbid_with({"run", job, "--out", folder.path() / "a"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const auto registered = tests::orbid_with(
        {"run", orbid::tests::source_folder() + "/configs/lorenz.json", "--out", folder.path() / "b"});
    REQUIRE(registered.code == 0);
    const json mine = tests::read_json(folder.path() / "a" / "result.json");
    const json theirs = tests::read_json(folder.path() / "b" / "result.json");
    CHECK(mine["model"]["evaluated"] == "interpreted");
    CHECK_FALSE(theirs.contains("model"));
    for (const char* name : {"sigma", "rho", "beta"}) {
        const double value = mine["parameters"][name]["value"], other = theirs["parameters"][name]["value"];
        // What the minimisation leaves of an sd; measured 1e-9 of it.
        CHECK(std::abs(value - other) < 1e-5 * theirs["parameters"][name]["sd"].get<double>());
    }
    // The stored job repeats the run.
    const auto again = tests::orbid_with({"run", folder.path() / "a" / "job.json", "--out", folder.path() / "c"});
    REQUIRE(again.code == 0);
    CHECK(read_whole_file(folder.path() / "c" / "result.json") == read_whole_file(folder.path() / "a" / "result.json"));
    const auto check = tests::orbid_with({"check", job});
    CHECK(check.code == 0);
    CHECK_THAT(check.out, ContainsSubstring("equations  interpreted, as the job says"));
}

TEST_CASE("equations are compiled where records of one length cost more", "[apps][check][equations]") {
    // 2000 readings of three coordinates each: 14 operations and 3 parameters; 106 operations and 29 parameters.
    const std::string systems = orbid::tests::source_folder() + "/configs/campaigns/chaotic_systems/";
    const std::string cheap = "equations  interpreted: the job is short";
    const auto rossler = tests::orbid_with({"check", systems + "Rossler.json"});
    CHECK_THAT(rossler.out, ContainsSubstring(cheap));
    const auto cell = tests::orbid_with({"check", systems + "ExcitableCell.json"});
    CHECK_THAT(cell.out, ContainsSubstring("  equations  ") && !ContainsSubstring(cheap));
}

TEST_CASE("the example with equations in the job finds its parameters", "[apps][run][equations]") {
    const tests::TemporaryFolder folder;
    const auto run = tests::orbid_with(
        {"run", orbid::tests::source_folder() + "/configs/duffing_equations.json", "--out", folder.path() / "out"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = tests::read_json(folder.path() / "out" / "result.json");
    for (const char* name : {"delta", "friction", "alpha", "beta", "gamma"}) {
        CAPTURE(name);
        const json& parameter = result["parameters"][name];
        CHECK(std::abs(parameter["value"].get<double>() - parameter["reference"].get<double>()) <
              4.0 * parameter["sd"].get<double>());
        CHECK(parameter["sd"].get<double>() < 0.05 * std::abs(parameter["reference"].get<double>()));
    }
    // 404 readings: the sd of their errors is known to 1 / sqrt(808) = 3.5 %; four of that.
    CHECK_THAT(result["errors"]["series.x"]["sd"].get<double>(), tests::WithinRel(0.005, 0.14));
}

}  // namespace job_equations_test
