// Sensors in a job: what is read, written, run and refused.

#include <cmath>
#include <numbers>
#include <sstream>

#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_sensor_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;
using tests::WithinAbs;

namespace {

/// A swing read by a sensor, and the damping from it.
std::string job_with(const std::string& sensor, const std::string& rest = "") {
    return R"({ "model": { "name": "free_pendulum" }, "seed": 5,
  "data": { "name": "swing", "simulate": { "samples": { "step": 0.01, "count": 301 }, "initial": [[1.5, 2]] },
    "sensor": )" +
           sensor + rest + R"( },
  "estimate": { "parameters": { "c2": { "start": 0.08 } }, "residuals": [ { "type": "series" } ] },
  "reference": { "c2": 0.05 }, "output": { "series": "csv" } })";
}

models::Sensor sensor_of(const std::string& sensor) {
    const std::string text = job_with(sensor);
    CAPTURE(problems(text));
    const auto reading = read_job(text, job_folder / "job.json");
    REQUIRE(reading.job);
    // The complete form says the same.
    const std::string complete = job_text(*reading.job, job_folder);
    const auto again = read_job(complete, job_folder / "job.json");
    REQUIRE(again.job);
    CHECK(job_text(*again.job, job_folder) == complete);
    return again.job->data[0].sensor;
}

void refused(const std::string& sensor, const std::string& expected) {
    check_only(job_with(sensor), expected);
}

}  // namespace

TEST_CASE("every sensor of a job is read", "[apps][job]") {
    using Type = models::Sensor::Type;
    using Rounding = models::Sensor::Rounding;
    const auto plain = sensor_of(R"({ "type": "state" })");
    CHECK(plain.type == Type::state);
    CHECK(plain.step == 0.0);

    const auto encoder = sensor_of(R"({ "type": "state", "angle": "phi", "step": 0.01, "rounding": "nearest" })");
    CHECK(encoder.type == Type::state);
    CHECK(encoder.angle == 0);
    CHECK(encoder.step == 0.01);
    CHECK(encoder.rounding == Rounding::nearest);

    const auto function = sensor_of(
        R"({ "type": "function", "readings": { "phi_dot": "phi_dot - c2 * phi", "phi": "phi + 0.01 * phi^2" },
             "angle": "phi", "step": 0.02 })");
    CHECK(function.type == Type::function);
    REQUIRE(function.functions.size() == 2);
    CHECK(function.functions[0].coordinate == 0);
    CHECK(function.functions[0].expression.text() == "phi + 0.01 * phi^2");
    CHECK(function.functions[1].expression.used() == std::vector<std::size_t>{0, 1, 4});
    CHECK(function.step == 0.02);
    CHECK(function.rounding == Rounding::none);

    const auto difference =
        sensor_of(R"({ "type": "angle_difference", "angle": "phi", "rate": "phi_dot", "delay": 0.015 })");
    CHECK(difference.type == Type::angle_difference);
    CHECK(difference.delay == 0.015);
}

TEST_CASE("sensors that cannot be meant are refused with place and rule", "[apps][job]") {
    const std::string at = "job.json:3: /data/sensor";
    refused(R"({ "type": "encoder" })", at + "/type: unknown value \"encoder\"");
    refused(R"({ "type": "function" })", at + ": \"readings\" is missing");
    refused(R"({ "type": "function", "readings": {} })", at + "/readings: must not be empty");
    refused(R"({ "type": "function", "readings": { "x": "phi" } })",
            at + "/readings/x: the model free_pendulum has no");
    refused(R"({ "type": "function", "readings": { "phi": "phi + c9" } })",
            at + "/readings/phi: character 7 of \"phi + c9\": unknown name \"c9\"");
    refused(R"({ "type": "function", "readings": { "phi": 1 } })", at + "/readings/phi: must be a text");
    refused(R"({ "type": "state", "readings": { "phi": "phi" } })",
            at + "/readings: belongs to \"type\": \"function\"");
    refused(R"({ "type": "state", "step": 0.01 })", at + ": \"angle\" is missing");
    refused(R"({ "type": "state", "angle": "phi_dot", "step": 0.01 })", at + "/angle: phi_dot is no angle");
    refused(R"({ "type": "state", "angle": "phi", "rounding": "nearest" })",
            at + "/rounding: rounding needs the encoder's \"step\" > 0");
    refused(R"({ "type": "state", "angle": "phi", "step": -1 })", at + "/step: must be >= 0, not -1");
    refused(R"({ "type": "state", "angle": "phi", "delay": 0.1 })",
            at + "/delay: belongs to \"type\": \"angle_difference\"");
}

TEST_CASE("cycles of readings by formulas are refused", "[apps][job]") {
    check_only(R"({ "model": { "name": "parametric_pendulum" },
      "data": { "simulate": { "sections": 1024 },
                "sensor": { "type": "function", "readings": { "phi_dot": "2 * phi_dot" } } },
      "orbits": { "periods": [1] } })",
               "/orbits: cycles read by a sensor \"function\": not in this version");
}

TEST_CASE("relative errors are refused for angles, not for formulas in their place", "[apps][job]") {
    const auto text = [](const std::string& sensor) {
        std::string job = job_with(sensor);
        const std::string residual = R"({ "type": "series" })";
        return job.replace(job.find(residual), residual.size(),
                           R"({ "type": "series", "errors": { "phi": { "distribution": "relative" } } })");
    };
    check_only(text(R"({ "type": "state" })"), "phi is an angle: it has no size");
    check_only(text(R"({ "type": "function", "readings": { "phi_dot": "phi" } })"), "phi is an angle: it has no size");
    CHECK(problems(text(R"x({ "type": "function", "readings": { "phi": "2 + sin(phi)" } })x")).empty());
}

TEST_CASE("an encoder and a formula are simulated, fitted and predicted", "[apps][run]") {
    const double step = 2.0 * std::numbers::pi / 1000.0;
    const std::string encoder = fmt::format(R"("angle": "phi", "step": {}, "rounding": "nearest")", step);
    for (const std::string& sensor :
         {"{ \"type\": \"state\", " + encoder + " }",
          R"({ "type": "function", "readings": { "phi": "phi + 0.05 * phi^2" }, )" + encoder + " }"}) {
        CAPTURE(sensor);
        const tests::TemporaryFolder work;
        const auto out = work.path() / "out";
        const auto run = tests::orbid_with(
            {"run", tests::write_text(work.path() / "job.json", job_with(sensor, R"(, "observe": ["phi"])")), "--out",
             out});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        const auto result = tests::read_json(out / "result.json");
        const auto& c2 = result["parameters"]["c2"];
        CHECK(std::abs(c2["value"].get<double>() - 0.05) < 4.0 * c2["sd"].get<double>());
        // Uniform errors of rounding have the sd step / sqrt(12), here known to a tenth.
        CHECK_THAT(result["errors"]["series.phi"]["sd"].get<double>(),
                   WithinAbs(step / std::sqrt(12.0), 0.1 * step / std::sqrt(12.0)));
        // The complete job runs again to the same result.
        CHECK(tests::orbid_with({"run", out / "job.json", "--out", work.path() / "again"}).code == 0);
        CHECK(read_whole_file(out / "result.json") == read_whole_file(work.path() / "again" / "result.json"));
    }
}

}  // namespace job_sensor_test
