// The whole program on small jobs: what it stores, prints and returns.

#include <chrono>
#include <cmath>
#include <csignal>
#include <thread>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace run_test {

using namespace orbid::tests;

namespace {

void check_keys(const json& object, const std::vector<std::string>& keys) {
    for (const std::string& key : keys) {
        CAPTURE(key);
        CHECK(object.contains(key));
    }
}

}  // namespace

TEST_CASE("a run stores every file of the contract with its keys", "[apps][run]") {
    const TemporaryFolder folder;
    json job = pendulum_job();
    job["periodic"] = json::parse(R"({ "orbits": [ { "period": 1, "points": [[2.96, 6.40]] } ] })");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out, "--threads", "2"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    CHECK_THAT(run.out, ContainsSubstring("Unstable periodic orbits") && ContainsSubstring("a short pendulum") &&
                            ContainsSubstring("converged"));
    CHECK_THAT(run.error, ContainsSubstring("simulate") && ContainsSubstring("16384 points in 4 segments"));

    const auto files = content(out);
    std::vector<std::string> names;
    for (const auto& file : files)
        names.push_back(file.first);
    CHECK(names == std::vector<std::string>{"cycles.json", "job.json", "log.txt", "orbits.json", "report.html",
                                            "residuals.csv", "result.json", "section.svg", "series.h5", "timing.json"});

    const json cycles = read_json(out / "cycles.json");
    CHECK(cycles["format"] == "orbid-cycles/1");
    CHECK(cycles["model"] == "parametric_pendulum");
    CHECK(cycles["coordinates"] == json({"phi", "phi_dot"}));
    CHECK(cycles["units"] == json({"rad", "rad/s"}));
    REQUIRE_FALSE(cycles["cycles"].empty());
    check_keys(cycles, {"section", "fingerprint"});
    for (const json& cycle : cycles["cycles"]) {
        check_keys(cycle, {"period", "rotation", "points", "covariance", "multipliers", "ln_multiplier",
                           "ln_multiplier_covariance", "time", "recurrences", "mirror", "quality"});
        CHECK(cycle["points"].size() == cycle["period"].get<std::size_t>());
    }
    const json orbits = read_json(out / "orbits.json");
    REQUIRE(orbits["cycles"].size() == 1);
    check_keys(orbits["cycles"][0], {"period", "points", "multipliers", "residual", "status", "sensitivities"});
    CHECK(orbits["cycles"][0]["status"] == "converged");

    const json result = read_json(out / "result.json");
    CHECK(result["format"] == "orbid-result/1");
    CHECK(result["status"] == "converged");
    check_keys(result, {"message", "parameters", "derived", "errors", "initial_states", "prediction", "correlation",
                        "identifiability", "residuals", "objective", "log_likelihood", "degrees_of_freedom",
                        "iterations", "evaluations", "orbits", "data"});
    check_keys(result["identifiability"], {"singular_values", "null_directions", "trust_normal", "effective_count"});
    check_keys(result["errors"]["cycles.phi"], {"sd", "factor", "uncertainty", "unit", "count"});
    for (const char* name : {"l", "k2", "k3"}) {
        check_keys(result["parameters"][name], {"value", "sd", "interval95", "interval_method", "start", "reference",
                                                "relative_deviation", "unit", "at_bound"});
    }
    CHECK(result["parameters"]["l"]["start"] == 0.33);
    CHECK(result["parameters"]["l"]["reference"] == 0.317);
    // The data are noise-free: the true values must be met within a few reported standard deviations.
    const double l_error = result["parameters"]["l"]["value"].get<double>() - 0.317;
    CHECK(std::abs(l_error) < 4.0 * result["parameters"]["l"]["sd"].get<double>());
    CHECK(std::abs(result["derived"]["k2_over_m"]["value"].get<double>() - 5.652680652680653e-3) <
          4.0 * result["derived"]["k2_over_m"]["sd"].get<double>());
    CHECK(result["data"]["points"] == 16384);
    CHECK(result["data"]["segments"] == 4);
    std::size_t found = 0;
    for (const auto& count : result["orbits"]["found"])
        found += count.get<std::size_t>();
    CHECK(found == cycles["cycles"].size());

    CHECK_THAT(files.at("residuals.csv"),
               Catch::Matchers::StartsWith(
                   "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd\nrun1,"));
    CHECK_THAT(files.at("section.svg"), Catch::Matchers::StartsWith("<?xml") || Catch::Matchers::StartsWith("<svg"));
    CHECK_THAT(files.at("log.txt"), ContainsSubstring("one-period prediction"));
    const json timing = read_json(out / "timing.json");
    CHECK(timing["threads"] == 2);
}

TEST_CASE("results do not depend on the number of threads", "[apps][run]") {
    const TemporaryFolder folder;
    const Path job = write_job(folder.path() / "job.json", pendulum_job());
    std::map<std::string, std::string> first;
    for (const char* threads : {"1", "2", "4"}) {
        CAPTURE(threads);
        const Path out = folder.path() / (std::string("out") + threads);
        REQUIRE(orbid_with({"run", job, "--out", out, "--threads", threads, "--quiet"}).code == 0);
        auto files = content(out);
        files.erase("timing.json");
        files.erase("log.txt");
        files.erase("report.html");  // shows the times
        if (first.empty()) first = files;
        CHECK(first.size() == 7);
        for (const auto& [name, bytes] : first) {
            CAPTURE(name);
            CHECK((files.at(name) == bytes));
        }
    }
}

TEST_CASE("a period that is not found is listed, and no error", "[apps][run]") {
    const TemporaryFolder folder;
    json job = pendulum_job(8192);
    job["orbits"]["periods"] = {1, 2, 29};
    job["orbits"]["box"] = 0.01;
    job["orbits"]["minimum_recurrences"] = 3;  // of so long a cycle 8192 points hold one recurrence at most
    job["estimate"]["parameters"] = json::parse(R"({ "l": { "start": 0.32 } })");
    job["estimate"].erase("derived");
    job["reference"].erase("k2_over_m");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CHECK(run.code == 0);
    CHECK_THAT(run.error, ContainsSubstring("no cycle of period 29 was found"));
    CHECK(read_json(out / "result.json")["orbits"]["missing"] == json({29}));
}

TEST_CASE("nothing found at all gives code 1 and a stored result", "[apps][run]") {
    const TemporaryFolder folder;
    json job = pendulum_job(2000);
    job["orbits"]["periods"] = {13};
    job["orbits"]["box"] = 0.01;
    job["orbits"]["minimum_recurrences"] = 3;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CHECK(run.code == 1);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "failed");
    CHECK_THAT(result["message"].get<std::string>(), ContainsSubstring("no cycle was found"));
    CHECK(result["orbits"]["missing"] == json({13}));
    CHECK(orbid_with({"orbits", folder.path() / "job.json", "--out", out}).code == 1);
}

TEST_CASE("periodic orbits are computed from starts, the failed one is named", "[apps][run]") {
    const TemporaryFolder folder;
    const json job = json::parse(R"({ "model": { "name": "parametric_pendulum" },
      "periodic": { "orbits": [ { "period": 1, "rotation": [1], "points": [[2.96, 6.40]] },
                                { "period": 1, "rotation": [9], "points": [[2.96, 6.40]] } ] } })");
    const Path file = write_job(folder.path() / "job.json", job);
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"periodic", file, "--out", out});
    CHECK(run.code == 0);
    const json orbits = read_json(out / "orbits.json")["cycles"];
    REQUIRE(orbits.size() == 2);
    CHECK(orbits[0]["status"] == "converged");
    CHECK(orbits[0]["rotation"] == json({1}));
    // Nine turns in one period: not found. What is there instead stands there, and says so.
    CHECK(orbits[1]["status"] == "other_orbit");
    CHECK(orbits[1]["rotation"] == json({1}));
    CHECK_THAT(orbits[1]["message"].get<std::string>(), ContainsSubstring("none with the rotation +9 asked for"));
    CHECK(orbits[1]["points"] == orbits[0]["points"]);

    // The other commands have nothing to do here.
    for (const char* command : {"simulate", "orbits", "estimate"}) {
        const Outcome refused = orbid_with({command, file, "--out", folder.path() / "other"});
        CHECK(refused.code == 2);
        CHECK_THAT(refused.error, ContainsSubstring(fmt::format("{} needs", command)));
    }
    CHECK_FALSE(std::filesystem::exists(folder.path() / "other"));
}

TEST_CASE("periodic orbits by finite differences and collocation, and where these do not apply", "[apps][run]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({ "model": { "name": "parametric_pendulum" },
      "periodic": { "method": "collocation", "orbits": [ { "period": 1, "points": [[2.96, 6.40]] } ] } })");
    for (const char* method : {"collocation", "finite_difference"}) {
        CAPTURE(method);
        job["periodic"]["method"] = method;
        const Path out = folder.path() / method;
        CHECK(orbid_with({"periodic", write_job(folder.path() / "job.json", job), "--out", out}).code == 0);
        CHECK(read_json(out / "job.json")["periodic"]["method"] == method);
        const json orbit = read_json(out / "orbits.json")["cycles"][0];
        CHECK(orbit["status"] == "converged");
        // tests/reference/pendulum_orbits_g9.81.json; differences on 200 nodes are 7e-7 and 6e-5 off.
        const double tolerance = std::string(method) == "collocation" ? 1e-9 : 1e-4;
        CHECK_THAT(orbit["points"][0][0].get<double>(), WithinAbs(2.966784281971485, tolerance));
        CHECK_THAT(orbit["points"][0][1].get<double>(), WithinAbs(6.406582448046664, tolerance));
    }
    job["model"]["parameters"]["k1"] = 1e-3;
    const Outcome rough = orbid_with({"check", write_job(folder.path() / "job.json", job)});
    CHECK(rough.code == 2);
    CHECK_THAT(rough.error, ContainsSubstring("/periodic/method: the model parametric_pendulum is not smooth"));
    const json map = json::parse(R"({ "model": { "name": "henon" },
      "periodic": { "method": "collocation", "orbits": [ { "period": 1, "points": [[0.6, 0.2]] } ] } })");
    CHECK_THAT(orbid_with({"check", write_job(folder.path() / "map.json", map)}).error,
               ContainsSubstring("the model henon is a map"));
}

TEST_CASE("periodic orbits of an autonomous flow start on a section", "[apps][run]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({ "model": { "name": "lorenz" },
      "section": { "coordinate": "z", "value": 27, "direction": 1 },
      "periodic": { "orbits": [ { "period": 2, "points": [[-13.7, -19.5, 27], [13.7, 19.5, 27]] },
                                { "period": 1, "points": [[8.6, 8.4, 27]] } ] } })");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"periodic", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    CHECK(run.code == 0);
    const json orbits = read_json(out / "orbits.json")["cycles"];
    // The orbit AB of tests/reference/lorenz_orbits.json.
    CHECK(orbits[0]["status"] == "converged");
    CHECK_THAT(orbits[0]["time"].get<double>(), WithinAbs(1.55865221071617472756787, 1e-11));
    CHECK_THAT(orbits[0]["points"][0][0].get<double>(), WithinAbs(-13.7636106821342005250144, 1e-9));
    CHECK(orbits[0]["points"][0].size() == 3);
    CHECK(orbits[0]["multipliers"].size() == 2);
    CHECK_THAT(orbits[0]["multipliers"][0][0].get<double>(), WithinAbs(4.7129472734240821825, 1e-8));
    CHECK(orbits[1]["status"] == "equilibrium");
    CHECK_THAT(orbits[1]["points"][0][0].get<double>(), WithinAbs(std::sqrt(72.0), 1e-4));

    job.erase("section");
    const Outcome refused = orbid_with({"check", write_job(folder.path() / "job.json", job)});
    CHECK(refused.code == 2);
    CHECK_THAT(refused.error, ContainsSubstring("needs a \"section\" in the job that its orbits cross"));
}

TEST_CASE("an interrupted run stores a valid result", "[apps][run]") {
    const TemporaryFolder folder;
    const json job = pendulum_job(32768);
    const Path out = folder.path() / "out";
    const Path file = write_job(folder.path() / "job.json", job);
    // Should the run have ended when the signal comes, the test shall fail, not the whole process end.
    std::signal(SIGINT, SIG_IGN);
    std::thread user([&] {
        while (!std::filesystem::exists(out))
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        std::raise(SIGINT);
    });
    const Outcome run = orbid_with({"run", file, "--out", out});
    user.join();
    std::signal(SIGINT, SIG_DFL);
    CHECK(run.code == 130);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "interrupted");
    CHECK(result["format"] == "orbid-result/1");
    // A simulation that was left has stored nothing. Started again, the run ends.
    CHECK(orbid_with({"run", file, "--out", out}).code == 0);
    CHECK(read_json(out / "result.json")["status"] == "converged");
}

}  // namespace run_test
