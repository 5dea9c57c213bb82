// A laser whose pulses repeat: the period is told from the record, and the waveform is fitted without a guess.

#include <cmath>
#include <fstream>
#include <sstream>

#include <fmt/format.h>

#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace laser_pulses_test {

using namespace orbid::tests;

namespace {

const std::string example = orbid::tests::source_folder() + "/configs/laser_pulses.json";

/// T of the orbit by Runge and Kutta's method of order 4 with steps of 5e-4 s, from maxima of x^2 after 1300 s.
constexpr double period = 3.447870;

void check_result(const json& result) {
    REQUIRE(result["status"] == "converged");
    REQUIRE(result["stages"].size() == 2);
    CHECK(result["stages"][0]["stage"] == "series");
    CHECK(result["stages"][1]["stage"] == "waveform");
    CHECK(result["stages"][1]["chosen"] == true);
    for (const auto& [name, parameter] : result["parameters"].items()) {
        CAPTURE(name, parameter.dump());
        const double truth = parameter["reference"];
        CHECK(parameter["interval95"][0].get<double>() <= truth);
        CHECK(truth <= parameter["interval95"][1].get<double>());
        // The intervals are not wide: gain and offset to 1 %, the others to 0.5 %.
        CHECK(parameter["sd"].get<double>() < 5e-3 * truth);
    }
    CHECK(result["steady_states"][0]["status"] == "converged");
    // The intensity repeats before the field does, which changes its sign. At parameters that are a little off:
    // measured 1.7e-5.
    CHECK(std::abs(result["steady_states"][0]["time"].get<double>() - 2.0 * period) < 2e-4);
}

}  // namespace

TEST_CASE("the example of periodic pulses", "[apps][run][waveform][period]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", example, "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    check_result(read_json(out / "result.json"));
    const std::string log = orbid::apps::read_whole_file(out / "log.txt");
    CHECK_THAT(log, ContainsSubstring("laser: repeats after 3.447"));
    CHECK_THAT(log, ContainsSubstring("with 5 maxima of x"));
    // The stored job says what was chosen, and is itself a job.
    const json complete = read_json(out / "job.json");
    CHECK(complete["estimate"]["strategy"] == json({"series", "waveform"}));
    CHECK(complete["estimate"]["residuals"][1]["time"]["laser"] == "auto");
    CHECK(problems(complete.dump(1)).empty());
}

TEST_CASE("counts of eight bits, from other starts", "[apps][run][waveform][period]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "simulated";
    REQUIRE(orbid_with({"simulate", example, "--out", out, "--quiet"}).code == 0);
    std::istringstream lines(orbid::apps::read_whole_file(out / "series.csv"));
    std::ofstream table(folder.path() / "laser.csv");
    table << "t,counts\n";
    std::size_t row = 0;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("#") || line.starts_with("segment")) continue;
        std::istringstream cells(line);
        std::string segment, time, x;
        std::getline(cells, segment, ',');
        std::getline(cells, time, ',');
        std::getline(cells, x, ',');
        table << fmt::format("{:.3f},{:.0f}\n", 0.035 * static_cast<double>(row++),
                             std::min(std::max(std::round(std::stod(x)), 0.0), 255.0));
    }
    table.close();
    REQUIRE(row == 2000);

    json job = json::parse(orbid::apps::read_whole_file(example), nullptr, true, true);
    json& data = job["data"];
    data.erase("simulate");
    data["file"] = "laser.csv";
    data["kind"] = "samples";
    data["columns"] = {{"time", "t"}, {"x", "counts"}};
    // 10 to 30 % off, in either direction.
    const std::vector<std::map<std::string, double>> starts{
        {{"s", 10.5}, {"r", 88.0}, {"b", 1.2}, {"gain", 0.5}, {"offset", 12.0}},
        {{"s", 16.5}, {"r", 90.0}, {"b", 1.25}, {"gain", 0.45}, {"offset", 12.0}}};
    for (std::size_t i = 0; i < starts.size(); ++i) {
        CAPTURE(i);
        for (const auto& [name, start] : starts[i])
            job["estimate"]["parameters"][name]["start"] = start;
        const Path result = folder.path() / fmt::format("out{}", i);
        const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", result, "--quiet"});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        check_result(read_json(result / "result.json"));
    }
}

TEST_CASE("a record that does not repeat is refused as a waveform, with what it does", "[apps][waveform][period]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({
      "model": { "name": "lorenz" },
      "data": { "name": "chaos", "simulate": { "samples": { "step": 0.02, "count": 600 }, "transient": 500,
                "initial": [[1.0, 2.0, 20.0]], "noise": { "x": 0.1, "y": 0.1, "z": 0.1 } } },
      "estimate": { "parameters": { "rho": { "start": 27 } }, "strategy": ["waveform"],
                    "residuals": [ { "type": "waveform" } ] } })");
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet"});
    CAPTURE(run.error);
    CHECK(run.code == 3);
    CHECK_THAT(run.error, ContainsSubstring("chaos: the record does not repeat: it comes nearest to itself after"));
    CHECK_THAT(run.error, ContainsSubstring("give \"time\", a guess of its period in s"));
}

}  // namespace laser_pulses_test
