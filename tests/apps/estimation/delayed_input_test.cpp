// A delay of a measured input that a job names as a parameter: simulated, estimated, predicted.

#include <cmath>
#include <fstream>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace delayed_input_test {

using namespace orbid;
using namespace orbid::tests;
using tests::ContainsSubstring;

namespace {

json job_with(const std::filesystem::path& folder) {
    std::ofstream table(folder / "drive.csv");
    table << "t,u\n";
    for (int k = 0; k <= 700; ++k) {
        const double t = 0.02 * k - 1.0;
        table << fmt::format("{},{}\n", t, 6.0 * std::sin(4.1 * t) + 5.0 * std::cos(7.3 * t + 0.4));
    }
    return {
        {"model",
         {{"equations", {{"x", "v"}, {"v", "u - k * x - c * v - 5 * x^3"}}},
          {"inputs", {{"u", "m/s^2"}}},
          {"parameters", {{"k", 30.0}, {"c", 0.8}, {"lag", {{"value", 0.013}, {"unit", "s"}}}}}}},
        {"seed", 4},
        {"data",
         {{"name", "rig"},
          {"simulate",
           {{"samples", {{"step", 0.02}, {"count", 501}}},
            {"initial", json::array({{0.2, -0.5}})},
            {"noise", {{"x", 3e-3}}}}},
          {"observe", {"x"}},
          {"inputs", {{"file", (folder / "drive.csv").string()}, {"u", "u"}}},
          {"interpolation", "cubic"},
          {"delay", "lag"}}},
        {"estimate",
         {{"parameters",
           {{"k", {{"start", 25.0}}}, {"c", {{"start", 1.2}}}, {"lag", {{"start", 0.004}, {"bounds", {0.0, 0.04}}}}}},
          {"residuals", json::array({{{"type", "series"}, {"interval", "segment"}}})}}}};
}

}  // namespace

TEST_CASE("a delay of an input is estimated by a job, with whole segments and with nodes", "[apps][run]") {
    const TemporaryFolder folder;
    json job = job_with(folder.path());
    for (const json& interval : {json("segment"), json(25)}) {
        CAPTURE(interval.dump());
        job["estimate"]["residuals"][0]["interval"] = interval;
        const Outcome run =
            orbid_with({"run", write_job(folder.path() / "job.json", job), "--out",
                        (folder.path() / (interval.is_string() ? "whole" : "nodes")).string(), "--quiet"});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        const json result = read_json(folder.path() / (interval.is_string() ? "whole" : "nodes") / "result.json");
        CHECK(result["status"] == "converged");
        const double sd = result["parameters"]["lag"]["sd"];
        CHECK(sd < 1e-3);
        CHECK(std::abs(result["parameters"]["lag"]["value"].get<double>() - 0.013) < 4.0 * sd);
    }
}

TEST_CASE("bounds of a delay that reach beyond the record of the input are refused", "[apps][run]") {
    const TemporaryFolder folder;
    json job = job_with(folder.path());
    job["estimate"]["parameters"]["lag"]["bounds"] = {0.0, 1.5};
    const Outcome run = orbid_with(
        {"run", write_job(folder.path() / "job.json", job), "--out", (folder.path() / "out").string(), "--quiet"});
    CHECK(run.code == 3);
    CHECK_THAT(run.error, ContainsSubstring("with delays in [0, 1.5] s"));
    // A parameter that neither an equation, a sensor nor a delay contains.
    job["data"]["delay"] = 0.0;
    const Outcome unused = orbid_with({"check", write_job(folder.path() / "job.json", job)});
    CHECK(unused.code == 2);
    CHECK_THAT(unused.error, ContainsSubstring("the parameter lag occurs in no formula"));
}

}  // namespace delayed_input_test
