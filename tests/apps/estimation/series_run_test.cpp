// Sampled data from simulation to estimate, and jobs of several experiments.

#include <cmath>
#include <filesystem>
#include <sstream>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace series_run_test {

using namespace orbid::tests;

namespace {

json duffing_job() {
    return json::parse(R"({
      "model": { "name": "duffing" },
      "seed": 3,
      "data": { "name": "swing", "simulate": { "samples": { "step": 0.05, "count": 401 }, "trajectories": 3,
                  "initial": [[1.0, 1.0], [0.5, 0.0], [-1.0, 0.3]], "noise": { "x": 0.01, "x_dot": 0.02 } },
                "segments": { "fit": ["1", "2"], "predict": ["3"] } },
      "estimate": { "parameters": { "delta": { "start": 0.33 } }, "residuals": [ { "type": "series" } ] },
      "reference": { "delta": 0.3 },
      "output": { "series": "csv" } })");
}

}  // namespace

TEST_CASE("sampled data are simulated, stored, fitted and predicted", "[apps][run]") {
    const TemporaryFolder folder;
    json job = duffing_job();
    const Path out = folder.path() / "out";
    // Which labels a simulation gives its segments stands in its file.
    job["data"].erase("segments");
    REQUIRE(orbid_with({"simulate", write_job(folder.path() / "labels.json", job), "--out", folder.path() / "labels"})
                .code == 0);
    std::vector<std::string> labels;
    std::istringstream lines(orbid::apps::read_whole_file(folder.path() / "labels" / "series.csv"));
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("#") || line.starts_with("segment")) continue;
        const std::string label = line.substr(0, line.find(','));
        if (labels.empty() || labels.back() != label) labels.push_back(label);
    }
    REQUIRE(labels.size() == 3);
    job["data"]["segments"] = {{"fit", {labels[0], labels[1]}}, {"predict", {labels[2]}}};

    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    const json& delta = result["parameters"]["delta"];
    CHECK(std::abs(delta["value"].get<double>() - 0.3) < 4.0 * delta["sd"].get<double>());
    CHECK(delta["sd"].get<double>() < 0.01);
    CHECK(delta["bias"] == 0.0);
    // 2 x 401 readings of each coordinate: the sd of their error is known to 1 / sqrt(2 * 802) = 2.5 %; four of that.
    CHECK_THAT(result["errors"]["series.x"]["sd"].get<double>(), WithinRel(0.01, 0.1));
    CHECK_THAT(result["errors"]["series.x_dot"]["sd"].get<double>(), WithinRel(0.02, 0.1));
    CHECK(result["errors"]["series.x"]["count"] == 802);
    REQUIRE(result["initial_states"].size() == 2);
    for (const json& state : result["initial_states"]) {
        for (const char* coordinate : {"x", "x_dot"}) {
            CHECK(state["state"][coordinate]["estimated"] == true);
            CHECK(state["state"][coordinate]["sd"].get<double>() > 0.0);
        }
    }
    const double x0 = result["initial_states"][0]["state"]["x"]["value"];
    CHECK(std::abs(x0 - 1.0) < 4.0 * result["initial_states"][0]["state"]["x"]["sd"].get<double>());
    REQUIRE(result["prediction"].size() == 3);
    CHECK(result["prediction"][2]["segment"] == labels[2]);
    CHECK(result["prediction"][2]["fitted"] == false);
    CHECK(result["prediction"][0]["fitted"] == true);
    std::istringstream residuals(orbid::apps::read_whole_file(out / "residuals.csv"));
    int rows = -1;  // the header
    for (std::string line; std::getline(residuals, line);)
        ++rows;
    CHECK(rows == 4 * 401);

    // Again, from the stored table: the same bytes.
    const auto before = content(out);
    REQUIRE(orbid_with({"run", folder.path() / "job.json", "--out", out, "--threads", "1"}).code == 0);
    CHECK(read_json(out / "timing.json")["stages"][0]["reused"] == true);
    const auto after = content(out);
    for (const char* name : {"series.csv", "result.json", "residuals.csv", "job.json"}) {
        CAPTURE(name);
        CHECK((after.at(name) == before.at(name)));
    }
}

TEST_CASE(
    "noise that gives a chaotic course a bias: it is taken off, the same for any number of threads and when going on",
    "[apps][run]") {
    const TemporaryFolder folder;
    const json job = json::parse(R"({
      "model": { "name": "parametric_pendulum", "parameters": { "l": 0.317, "k1": 1e-3, "k2": 4.85e-4, "k3": 1.9e-4 } },
      "seed": 8,
      "data": { "name": "run", "simulate": { "sections": 300, "transient": 20,
                                             "noise": { "phi": 0.0314, "phi_dot": 0.1465 } } },
      "estimate": { "parameters": { "l": { "start": 0.35 } },
                    "residuals": [ { "type": "series", "interval": "auto" } ] },
      "output": { "series": "none" } })");
    const Path file = write_job(folder.path() / "job.json", job);
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", file, "--out", out, "--threads", "1"});
    CAPTURE(run.out, run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    const json& l = result["parameters"]["l"];
    const double sd = l["sd"];
    // Half a sd in this record, 0.14 in the mean of eight.
    CHECK(l["bias"].get<double>() / sd < -0.3);
    CHECK(l["bias"].get<double>() / sd > -0.8);
    CHECK(std::abs(l["value"].get<double>() - 0.317) < 3.0 * sd);
    CHECK_THAT(run.out,
               ContainsSubstring("Taken off, the bias that errors of readings give by the course, in sds: l -0."));
    CHECK_THAT(orbid::apps::read_whole_file(out / "report.html"),
               ContainsSubstring("The bias that errors of readings give by the course was taken off: l -0."));
    // Going on from what is kept, and with more threads.
    const std::string bytes = orbid::apps::read_whole_file(out / "result.json");
    std::filesystem::remove(out / "result.json");
    REQUIRE(orbid_with({"run", file, "--out", out, "--threads", "1"}).code == 0);
    CHECK(orbid::apps::read_whole_file(out / "result.json") == bytes);
    const Path other = folder.path() / "other";
    REQUIRE(orbid_with({"run", file, "--out", other, "--threads", "4"}).code == 0);
    CHECK(orbid::apps::read_whole_file(other / "result.json") == bytes);
}

TEST_CASE("a segment that is not there is refused by name", "[apps][data]") {
    const TemporaryFolder folder;
    json job = duffing_job();
    job["data"]["segments"] = {{"fit", {"nowhere"}}, {"predict", json::array()}};
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet"});
    CHECK(run.code == 3);
    CHECK_THAT(run.error, ContainsSubstring("swing: there is no segment \"nowhere\""));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "out" / "result.json"));
}

TEST_CASE("several experiments share parameters and keep some for themselves", "[apps][run]") {
    const TemporaryFolder folder;
    const json job = json::parse(R"({
      "model": { "name": "duffing" },
      "data": [
        { "name": "soft", "parameters": { "gamma": 0.48 }, "free": ["gamma"],
          "simulate": { "samples": { "step": 0.05, "count": 201 }, "initial": [[1.0, 1.0]], "noise": { "x": 1e-3, "x_dot": 1e-3 } } },
        { "name": "hard", "parameters": { "gamma": 0.52 }, "free": ["gamma"],
          "simulate": { "samples": { "step": 0.05, "count": 201 }, "initial": [[0.2, 0.0]], "noise": { "x": 1e-3, "x_dot": 1e-3 } } } ],
      "estimate": { "parameters": { "delta": { "start": 0.32 }, "gamma": { "start": 0.5 } },
                    "residuals": [ { "type": "series", "data": ["soft", "hard"] } ] } })");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    CHECK(std::filesystem::exists(out / "series_soft.h5"));
    CHECK(std::filesystem::exists(out / "series_hard.h5"));
    const json parameters = read_json(out / "result.json")["parameters"];
    const std::map<std::string, double> truth{{"delta", 0.3}, {"gamma@soft", 0.48}, {"gamma@hard", 0.52}};
    CHECK(parameters.size() == truth.size());
    for (const auto& [name, value] : truth) {
        CAPTURE(name);
        REQUIRE(parameters.contains(name));
        CHECK(std::abs(parameters[name]["value"].get<double>() - value) < 4.0 * parameters[name]["sd"].get<double>());
        CHECK(parameters[name]["sd"].get<double>() < 0.01);
    }
    CHECK(orbid_with({"run", out / "job.json", "--out", folder.path() / "again"}).code == 0);
    CHECK(orbid::apps::read_whole_file(out / "result.json") ==
          orbid::apps::read_whole_file(folder.path() / "again" / "result.json"));
}

TEST_CASE("a chaotic record without a word on its intervals is followed from node to node", "[apps][run]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({
      "model": { "name": "lorenz" }, "seed": 1,
      "data": { "name": "run", "simulate": { "samples": { "step": 0.05, "count": 400 }, "initial": [[1, 1, 20]],
                "transient": 100, "noise": { "x": 1, "y": 1, "z": 1 } } },
      "estimate": { "parameters": { "sigma": { "start": 11 }, "rho": { "start": 26 }, "beta": { "start": 2.9 } },
                    "residuals": [ { "type": "series" } ] },
      "reference": { "sigma": 10, "rho": 28, "beta": 2.6666666666666665 },
      "output": { "series": "none" } })");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    CHECK_THAT(run.out + run.error, ContainsSubstring("times along a segment"));
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    CHECK(result["errors"].contains("series.matching.x"));
    for (const auto& [name, parameter] : result["parameters"].items()) {
        CAPTURE(name, parameter.dump());
        const double off = parameter["value"].get<double>() - parameter["reference"].get<double>();
        CHECK(std::abs(off) < 4.0 * parameter["sd"].get<double>());
    }
    // The stored job says no more than the one that was given.
    CHECK(!read_json(out / "job.json")["estimate"]["residuals"][0].contains("interval"));

    // A start whose motion is not chaotic says nothing of errors: the failure of whole segments does.
    json far = job;
    far["estimate"]["parameters"] = {{"rho", {{"start", 20}}}};
    const Outcome again = orbid_with({"run", write_job(folder.path() / "far.json", far), "--out", out, "--force"});
    CAPTURE(again.error, again.out);
    REQUIRE(again.code == 0);
    CHECK_THAT(again.out + again.error, ContainsSubstring("once more with nodes"));
    const json rho = read_json(out / "result.json")["parameters"]["rho"];
    CHECK(std::abs(rho["value"].get<double>() - 28.0) < 4.0 * rho["sd"].get<double>());

    // A known first state belongs to one course over the whole segment, and so do errors that last.
    job["data"]["initial_state"] = {{"x", {{"value", 1.0}}}};
    const Outcome check = orbid_with({"check", write_job(folder.path() / "known.json", job)});
    CHECK_THAT(check.out, ContainsSubstring("one trajectory per segment\n"));
    job["data"].erase("initial_state");
    job["estimate"]["residuals"][0]["errors"] = {{"x", {{"distribution", "ar1"}}}};
    const Outcome lasting = orbid_with({"check", write_job(folder.path() / "lasting.json", job)});
    CHECK_THAT(lasting.out, ContainsSubstring("one trajectory per segment\n"));
    job["estimate"]["residuals"][0].erase("errors");
    const Outcome free = orbid_with({"check", write_job(folder.path() / "free.json", job)});
    CHECK_THAT(free.out, ContainsSubstring("one trajectory per segment, nodes where errors grow along it"));
}

}  // namespace series_run_test
