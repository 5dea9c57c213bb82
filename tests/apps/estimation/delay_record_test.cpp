// Cycles of autonomous flows of which one coordinate is read: found in delays, and compared with the model as
// waveforms.

#include <cmath>

#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace delay_record_test {

using namespace orbid::tests;

namespace {

/// x alone, noise 1 % of its range, parameters 10 % off.
json lorenz_job() {
    return json::parse(R"({
      "model": { "name": "lorenz", "parameters": { "sigma": 10, "rho": 28, "beta": 2.6666666666666665 } },
      "seed": 3,
      "data": { "name": "osc", "observe": ["x"],
                "simulate": { "samples": { "step": 0.01, "count": 100000 }, "transient": 4000, "initial": [[1, 1, 20]],
                              "noise": { "x": 0.36 } } },
      "orbits": { "periods": [1, 2, 3, 4] },
      "estimate": { "parameters": { "sigma": { "start": 11 }, "rho": { "start": 25.5 }, "beta": { "start": 2.9 } },
                    "residuals": [ { "type": "waveform", "of": "cycles" } ] },
      "reference": { "sigma": 10, "rho": 28, "beta": 2.6666666666666665 },
      "output": { "series": "none" } })");
}

json roessler_job() {
    return json::parse(R"job({
      "model": { "equations": { "x": "-y - z", "y": "x + a * y", "z": "b + z * (x - c)" }, "compile": false,
                 "parameters": { "a": 0.2, "b": 0.2, "c": 5.7 } },
      "seed": 3,
      "data": { "name": "osc", "observe": ["x"],
                "simulate": { "samples": { "step": 0.05, "count": 160000 }, "transient": 4000, "initial": [[1, 1, 0]],
                              "noise": { "x": 0.2 } } },
      "orbits": { "periods": [1, 2, 3] },
      "estimate": { "parameters": { "a": { "start": 0.22 }, "b": { "start": 0.18 }, "c": { "start": 5.2 } },
                    "residuals": [ { "type": "waveform", "of": "cycles" } ] },
      "reference": { "a": 0.2, "b": 0.2, "c": 5.7 },
      "output": { "series": "none" } })job");
}

void check_within_intervals(const json& result) {
    CHECK(result["status"] == "converged");
    for (const auto& [name, parameter] : result["parameters"].items()) {
        CAPTURE(name, parameter.dump());
        const double truth = parameter["reference"];
        CHECK(parameter["interval95"][0].get<double>() <= truth);
        CHECK(truth <= parameter["interval95"][1].get<double>());
        // Nearer than the start by more than half, so that wide intervals do not pass.
        CHECK(std::abs(parameter["value"].get<double>() - truth) <
              0.5 * std::abs(parameter["start"].get<double>() - truth));
    }
}

}  // namespace

TEST_CASE("Lorenz equations from cycles in x alone", "[apps][run][delay]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", lorenz_job()), "--out", out});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    check_within_intervals(read_json(out / "result.json"));
    // What was chosen is told in the log and stored with the cycles.
    const json cycles = read_json(out / "cycles.json");
    const std::string said = cycles["remarks"].dump();
    CHECK_THAT(said, ContainsSubstring("states are vectors of 3 readings of x"));
    CHECK_THAT(said, ContainsSubstring("the section is "));
    CHECK_THAT(run.error, ContainsSubstring("the section is "));
    CHECK(cycles["cycles"].size() >= 2);
}

TEST_CASE("Roessler equations from cycles in x alone", "[apps][run][delay]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", roessler_job()), "--out", out, "--quiet"});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    // Errors of a cycle's points are common to all of its readings: intervals are too small here, values are not bad.
    // Measured 0.5 %, 1.5 %, 0.3 %.
    const json parameters = read_json(out / "result.json")["parameters"];
    for (const auto& [name, share] : std::map<std::string, double>{{"a", 0.02}, {"b", 0.05}, {"c", 0.01}}) {
        CAPTURE(name, parameters[name].dump());
        const double truth = parameters[name]["reference"];
        CHECK(std::abs(parameters[name]["value"].get<double>() - truth) < share * truth);
    }
}

TEST_CASE("embedding and section are overridden", "[apps][run][delay]") {
    const TemporaryFolder folder;
    json job = lorenz_job();
    job.erase("estimate");
    job["orbits"] = {{"periods", {1, 2}}, {"embedding", {{"delay", 15}, {"dimension", 3}}}};
    job["section"] = {{"coordinate", "x"}, {"value", 8.0}, {"direction", -1}};
    const Path out = folder.path() / "out";
    const Outcome run =
        orbid_with({"orbits", write_job(folder.path() / "job.json", job), "--out", out, "--quiet", "--force"});
    CAPTURE(run.error);
    CHECK(run.code <= 1);
    const json cycles = read_json(out / "cycles.json");
    CHECK_THAT(cycles["remarks"].dump(), ContainsSubstring("states are vectors of 3 readings of x, 15 samples apart"));
    CHECK_THAT(cycles["remarks"].dump(), !ContainsSubstring("of the planes tried"));
    const json complete = read_json(out / "job.json");
    CHECK(complete["orbits"]["embedding"] == json({{"delay", 15}, {"dimension", 3}}));
    CHECK(problems(complete.dump(1)).empty());
}

TEST_CASE("a record too short for cycles says what it holds", "[apps][run][delay]") {
    const TemporaryFolder folder;
    json job = lorenz_job();
    job.erase("estimate");
    const auto run = [&](std::size_t count) {
        job["data"]["simulate"]["samples"]["count"] = count;
        return orbid_with({"orbits", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out",
                           "--quiet", "--force"});
    };
    const Outcome some = run(6000);
    CAPTURE(some.error);
    CHECK(some.code == 1);
    const std::string said = read_json(folder.path() / "out" / "cycles.json")["remarks"].dump();
    CHECK_THAT(said, ContainsSubstring("a search needs 320"));
    CHECK_THAT(said, ContainsSubstring("The nearest returns are: period 1 to "));
    CHECK_THAT(said, ContainsSubstring("A residual of type series fits a record of any length"));
    const Outcome few = run(300);
    CAPTURE(few.error);
    CHECK(few.code == 3);
    CHECK_THAT(few.error, ContainsSubstring("x cannot be embedded"));
    CHECK_THAT(few.error, ContainsSubstring("A residual of type series fits a record of any length"));
}

TEST_CASE("what waveforms of cycles and embeddings cannot be is refused", "[apps][delay]") {
    CHECK(problems(lorenz_job().dump(1)).empty());
    const auto with = [](const char* pointer, const json& value) {
        json job = lorenz_job();
        job[json::json_pointer(pointer)] = value;
        return job.dump(1);
    };
    const std::string at = "/estimate/residuals/0";
    check_only(with("/estimate/residuals/0/time", 1.5), at + "/time: belongs to records");
    check_only(with("/estimate/residuals/0/of", "everything"), at + "/of");
    check_only(with("/orbits/embedding", {{"delay", 0}}), "/orbits/embedding/delay");
    check_only(with("/orbits/embedding", {{"lag", 3}}), "/orbits/embedding/lag");
    check_only(with("/section", "always"), "/section");
    check_only(with("/section", {{"coordinate", "z"}, {"value", 27}}),
               "/orbits: the section is at z, which is not read");
    json forced = json::parse(R"({ "model": { "name": "duffing" }, "section": "auto",
        "data": { "simulate": { "sections": 1000 } } })");
    check_only(forced.dump(1), "/section: the model duffing is not autonomous");
}

}  // namespace delay_record_test
