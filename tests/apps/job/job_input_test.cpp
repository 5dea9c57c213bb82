// Measured inputs in a job: what is read, written, run and refused.

#include <cmath>
#include <map>
#include <sstream>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/check/job_summary.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_input_test {

using namespace orbid;
using namespace orbid::apps;
using tests::ContainsSubstring;
using tests::Path;
using tests::problems;
using tests::WithinAbs;

namespace {

constexpr double amplitude = 0.03, omega = 12.0;  // of the ground, the defaults of the model with harmonic ground

/// z'' of the harmonic ground [m/s^2].
double acceleration(double t) {
    return -amplitude * omega * omega * std::cos(omega * t);
}

/// A record of the ground from -0.1 s to 2.1 s, in g and milliseconds; `gap`: a row without a value.
Path write_ground(const Path& folder, int gap = -1, double later_ms = 0.0) {
    std::string text = "ms,acc\n";
    for (int k = 0; k <= 440; ++k) {
        const double t = -0.1 + 0.005 * k;
        text += k == gap ? fmt::format("{},\n", 1e3 * t)
                         : fmt::format("{},{}\n", 1e3 * t + later_ms, acceleration(t) / 9.80665);
    }
    return tests::write_text(folder / "ground.csv", text);
}

std::string job_with(const std::string& data, const std::string& variant = "measured_base") {
    return R"({ "model": { "name": "landing_gear_damper", "variant": ")" + variant + R"(" }, "seed": 4,
  "data": { "name": "roll", )" +
           data + R"( },
  "output": { "series": "csv" } })";
}

const std::string simulated = R"("simulate": { "samples": { "step": 0.01, "count": 201 }, "initial": [[0.14, 0.1]] })";
const std::string ground = R"("inputs": { "file": "ground.csv", "time": { "column": "ms", "unit": "ms" },
    "base_acceleration": { "column": "acc", "unit": "g" } }, "interpolation": "cubic")";

/// Columns of a table with a header, comments left out.
std::vector<std::vector<double>> table(const Path& file) {
    std::vector<std::vector<double>> rows;
    std::istringstream lines(read_whole_file(file));
    bool header = true;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("#")) continue;
        if (!std::exchange(header, false)) {
            rows.emplace_back();
            std::istringstream cells(line);
            for (std::string cell; std::getline(cells, cell, ',');)
                rows.back().push_back(std::stod(cell));
        }
    }
    return rows;
}

}  // namespace

TEST_CASE("measured inputs are read and written", "[apps][job]") {
    const tests::TemporaryFolder folder;
    write_ground(folder.path());
    const auto reading = read_job(job_with(simulated + ", " + ground), folder.path() / "job.json");
    REQUIRE(reading.job);
    const InputJob& input = *reading.job->data[0].inputs;
    CHECK(input.file->filename() == "ground.csv");
    CHECK(input.time_column == "ms");
    CHECK(input.time_unit == "ms");
    REQUIRE(input.columns.size() == 1);
    CHECK(input.columns[0].column == "acc");
    CHECK(input.columns[0].unit == "g");
    CHECK(input.interpolation == models::InputSignal::Interpolation::cubic);
    const std::string complete = job_text(*reading.job, folder.path());
    const auto again = read_job(complete, folder.path() / "job.json");
    REQUIRE(again.job);
    CHECK(job_text(*again.job, folder.path()) == complete);
    CHECK_THAT(job_summary(*reading.job),
               ContainsSubstring("  inputs     roll: base_acceleration from ground.csv, cubic\n"));
}

TEST_CASE("measured inputs that cannot be are refused with place and rule", "[apps][job]") {
    const tests::TemporaryFolder folder;
    write_ground(folder.path());
    tests::write_text(folder.path() / "run.csv", "t,stroke,acc\n0,0.1,0\n0.1,0.1,0\n");
    tests::write_text(folder.path() / "run.h5", "");
    const auto refused = [&](const std::string& data, const std::string& rule,
                             const std::string& variant = "measured_base") {
        // That a record alone is nothing to do is another matter.
        auto found = problems(job_with(data, variant), folder.path());
        std::erase_if(found, [](const std::string& problem) { return problem.find("/data") == std::string::npos; });
        CAPTURE(data, found);
        REQUIRE(found.size() == 1);
        CHECK_THAT(found[0], ContainsSubstring(rule));
    };
    refused(simulated, "/data: the model landing_gear_damper reads measured inputs (base_acceleration): \"inputs\" is");
    refused(simulated + ", " + ground, "/data/inputs: the model landing_gear_damper, variant harmonic_base, reads no",
            "harmonic_base");
    refused(simulated + R"(, "inputs": { "base_acceleration": "acc" })",
            "/data/inputs: inputs of a simulation need a \"file\"");
    refused(simulated + R"(, "inputs": { "file": "none.csv", "base_acceleration": "acc" })", "does not exist");
    refused(simulated + R"(, "inputs": { "file": "ground.csv" })", "/data/inputs: \"base_acceleration\" is missing");
    refused(simulated + R"(, "inputs": { "file": "ground.csv", "base_acceleration": "acc", "base": "acc" })",
            "/data/inputs/base: unknown key; known: \"file\", \"sha256\", \"time\", \"base_acceleration\"");
    refused(
        simulated + R"(, "inputs": { "file": "ground.csv", "base_acceleration": { "column": "acc", "unit": "m" } })",
        "/data/inputs/base_acceleration/unit: unit \"m\" cannot be turned into m/s^2");
    refused(simulated + R"(, "inputs": { "file": "ground.csv", "base_acceleration": "acc" }, "interpolation": "step")",
            "/data/interpolation: unknown value \"step\"");
    const std::string file = R"("kind": "samples", "columns": { "time": "t", "stroke": "stroke" })";
    refused(R"("file": "run.csv", )" + file +
                R"(, "interpolation": "cubic", "inputs": { "base_acceleration": "acc", "time": "t" })",
            "/data/inputs/time: belongs to \"file\"");
    refused(R"("file": "run.h5", "kind": "samples", "inputs": { "base_acceleration": "acc" })",
            "/data/inputs: inputs come from a table; beside");
    refused(
        R"("file": "run.csv", "kind": "section", "columns": { "stroke": "stroke" }, "inputs": { "base_acceleration": "acc" })",
        "/data/inputs: measured inputs of a section series: not in this version");
    refused(
        R"("simulate": { "samples": { "step": 0.01, "count": 201 }, "initial": [[0.14, 0.1]] }, "interpolation": "cubic")",
        "/data/interpolation: belongs to \"inputs\", which is missing", "harmonic_base");
}

TEST_CASE("a sensor reads measured inputs and parameters that no equation has", "[apps][run]") {
    const tests::TemporaryFolder folder;
    write_ground(folder.path());
    const std::string text = R"({
  "model": { "equations": { "x": "v", "v": "-k * x - c * v" }, "inputs": { "acc": "m/s^2" },
             "parameters": { "k": 40, "c": 0.8, "h0": 0.5, "gain": 0.02 } },
  "data": { "simulate": { "samples": { "step": 0.01, "count": 201 }, "initial": [[0.14, 0.1]], "noise": { "x": 1e-5 } },
            "inputs": { "file": "ground.csv", "time": { "column": "ms", "unit": "ms" },
                        "acc": { "column": "acc", "unit": "g" } }, "interpolation": "cubic", "observe": ["x"],
            "sensor": { "type": "function", "readings": { "x": "h0 + x + gain * acc" } } },
  "estimate": { "parameters": { "k": { "start": 38 }, "h0": { "start": 0.45 }, "gain": { "start": 0.03 } },
                "residuals": [ { "type": "series", "interval": "segment" } ] },
  "output": { "series": "csv" } })";
    const auto run = tests::orbid_with({"run", tests::write_text(folder.path() / "job.json", text)});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const auto rows = table(folder.path() / "job" / "series.csv");
    REQUIRE(rows.size() == 201);
    // At time 0 the state is the one given; five sds of the noise.
    CHECK_THAT(rows[0].at(2), WithinAbs(0.5 + 0.14 + 0.02 * acceleration(0.0), 5e-5));
    const auto result = tests::read_json(folder.path() / "job" / "result.json");
    const std::map<std::string, double> truth{{"k", 40.0}, {"h0", 0.5}, {"gain", 0.02}};
    for (const auto& [name, value] : truth) {
        CAPTURE(name);
        const auto& found = result["parameters"][name];
        CHECK(std::abs(found["value"].get<double>() - value) < 4.0 * found["sd"].get<double>());
        CHECK(found["sd"].get<double>() < 1e-3 * value);
    }
    // What neither the equations nor a sensor use is still refused.
    std::string unused = text;
    unused.replace(unused.find("h0 + x"), 6, "x");
    const auto found = problems(unused, folder.path());
    REQUIRE(found.size() == 1);
    CHECK_THAT(found[0], ContainsSubstring("/model/parameters/h0: the parameter h0 occurs in no formula: remove it"));
}

TEST_CASE("a measured ground moves the strut as the harmonic one it was taken from", "[apps][run]") {
    const tests::TemporaryFolder folder;
    write_ground(folder.path());
    const auto measured = tests::write_text(folder.path() / "job.json", job_with(simulated + ", " + ground));
    const auto harmonic = tests::write_text(folder.path() / "harmonic.json", job_with(simulated, "harmonic_base"));
    const auto run = tests::orbid_with({"run", measured, "--out", folder.path() / "out"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    REQUIRE(tests::orbid_with({"run", harmonic, "--out", folder.path() / "harmonic"}).code == 0);
    const auto by_input = table(folder.path() / "out" / "series.csv");
    const auto by_formula = table(folder.path() / "harmonic" / "series.csv");
    REQUIRE(by_input.size() == 201);
    double worst = 0.0;
    for (std::size_t k = 0; k < 201; ++k)
        worst = std::max(worst, std::abs(by_input[k][2] - by_formula[k][2]));
    // The spline errs by h^4 z'''' / 384 = 1.5e-7 m/s^2 (h = 5 ms), which over a second moves the strut less than this.
    CHECK(worst < 1e-7);
    CHECK(worst > 0.0);
    // Another ground: the stored series is stale.
    tests::write_text(folder.path() / "ground.csv", "ms,acc\n-100,0\n3000,0\n");
    CHECK(tests::orbid_with({"run", measured, "--out", folder.path() / "out"}).code == 2);
    CHECK(tests::orbid_with({"run", measured, "--out", folder.path() / "out", "--force"}).code == 0);
    CHECK(std::abs(table(folder.path() / "out" / "series.csv").back()[2] - by_input.back()[2]) > 1e-3);
}

TEST_CASE("a delayed input is the input of a later clock", "[apps][run]") {
    const tests::TemporaryFolder folder;
    const auto strut = [&](const std::string& name, double later_ms, const std::string& more) {
        write_ground(folder.path(), -1, later_ms);
        const auto job =
            tests::write_text(folder.path() / (name + ".json"), job_with(simulated + ", " + ground + more));
        const auto run = tests::orbid_with({"run", job});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        return table(folder.path() / name / "series.csv");
    };
    const auto now = strut("now", 0.0, "");
    const auto delayed = strut("delayed", 0.0, R"(, "delay": 0.05)");
    const auto later = strut("later", 50.0, "");
    REQUIRE(delayed.size() == 201);
    double worst = 0.0, moved = 0.0;
    for (std::size_t k = 0; k < 201; ++k) {
        worst = std::max(worst, std::abs(delayed[k][2] - later[k][2]));
        moved = std::max(moved, std::abs(delayed[k][2] - now[k][2]));
    }
    // The instants differ by rounding.
    CHECK(worst < 1e-11);
    CHECK(moved > 1e-3);
}

TEST_CASE("damping is estimated from a record with its ground in the same table", "[apps][run]") {
    const tests::TemporaryFolder folder;
    const auto harmonic = tests::write_text(
        folder.path() / "harmonic.json",
        job_with(R"("simulate": { "samples": { "step": 0.01, "count": 151 }, "initial": [[0.14, 0.1], [0.1, -0.2]],
                    "trajectories": 2, "noise": { "stroke": 1e-4 } })",
                 "harmonic_base"));
    REQUIRE(tests::orbid_with({"run", harmonic, "--out", folder.path() / "harmonic"}).code == 0);
    std::string text = "run,t,stroke,acc\n";
    for (const auto& row : table(folder.path() / "harmonic" / "series.csv"))
        text += fmt::format("{},{},{},{}\n", row[0], row[1], row[2], -acceleration(row[1]) + 0.5);
    tests::write_text(folder.path() / "run.csv", text);
    const auto with = [&](const std::string& estimate, const std::string& name = "job.json") {
        return tests::write_text(folder.path() / name,
                                 R"({ "model": { "name": "landing_gear_damper", "variant": "measured_base" },
      "data": { "name": "roll", "file": "run.csv", "kind": "samples",
        "columns": { "segment": "run", "time": "t", "stroke": "stroke" },
        "inputs": { "base_acceleration": { "column": "acc", "sign": -1, "offset": 0.5 } }, "interpolation": "cubic",
        "segments": { "fit": [0], "predict": [1] } },
      "estimate": )" + estimate + " }");
    };
    const auto job = with(R"({ "parameters": { "c_compression": { "start": 1.5e4 }, "c_rebound": { "start": 8e4 } },
                              "residuals": [ { "type": "series" } ] })");
    const auto run = tests::orbid_with({"run", job, "--out", folder.path() / "out"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const auto result = tests::read_json(folder.path() / "out" / "result.json");
    for (const auto& [name, truth] : std::map<std::string, double>{{"c_compression", 2e4}, {"c_rebound", 6e4}}) {
        CAPTURE(name);
        const auto& parameter = result["parameters"][name];
        CHECK(std::abs(parameter["value"].get<double>() - truth) < 4.0 * parameter["sd"].get<double>());
        CHECK(parameter["sd"].get<double>() < 0.05 * truth);
    }
    REQUIRE(result["prediction"].size() == 2);
    CHECK(result["prediction"][1]["rms"]["stroke"].get<double>() < 2e-4);
    // The same with nodes along the record: exact matching has the same minimum.
    const auto nodes = with(R"({ "parameters": { "c_compression": { "start": 1.5e4 }, "c_rebound": { "start": 8e4 } },
                                "residuals": [ { "type": "series", "interval": 30 } ] })",
                            "nodes.json");
    const auto shooting = tests::orbid_with({"run", nodes, "--out", folder.path() / "nodes"});
    CAPTURE(shooting.error);
    REQUIRE(shooting.code == 0);
    const auto matched = tests::read_json(folder.path() / "nodes" / "result.json");
    CHECK(matched["parameters"].size() == 2);
    for (const auto& [name, found] : matched["parameters"].items()) {
        CAPTURE(name);
        const auto& whole = result["parameters"][name];
        CHECK(std::abs(found["value"].get<double>() - whole["value"].get<double>()) < 0.2 * whole["sd"].get<double>());
    }

    // A gap in the ground names its line; a record that ends too early its segment.
    const std::string whole = text;
    const auto line = text.find("\n0,0.5,") + 1;
    text.erase(text.rfind(',', text.find('\n', line)) + 1,
               text.find('\n', line) - text.rfind(',', text.find('\n', line)) - 1);
    tests::write_text(folder.path() / "run.csv", text);
    const auto gap = tests::orbid_with({"run", job, "--out", folder.path() / "gap"});
    CHECK(gap.code == 3);
    CHECK_THAT(gap.error, ContainsSubstring("run.csv:52, column \"acc\": is empty; this column must be complete"));
    tests::write_text(folder.path() / "run.csv", whole);
    write_ground(folder.path(), -1);
    std::string other = read_whole_file(job);
    const std::string own = R"("base_acceleration": { "column": "acc", "sign": -1, "offset": 0.5 })";
    tests::write_text(folder.path() / "short.csv", "t,acc\n0,1\n1.2,2\n");
    other.replace(other.find(own), own.size(), R"("file": "short.csv", "base_acceleration": "acc")");
    const auto early = tests::orbid_with(
        {"run", tests::write_text(folder.path() / "early.json", other), "--out", folder.path() / "early"});
    CHECK(early.code == 3);
    CHECK_THAT(early.error,
               ContainsSubstring("roll: series residual: segment 0: the measured inputs cover [0, 1.2] s"));
}

}  // namespace job_input_test
