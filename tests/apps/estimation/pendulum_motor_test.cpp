// A real pendulum with a motor: the second half of its swing-up is predicted from the first, and a strategy without
// nodes by hand gives a sensible result.

#include <string>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace pendulum_motor_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

json motor_job() {
    json job =
        json::parse(apps::read_whole_file(source_folder() + "/configs/pendulum_motor.json"), nullptr, true, true);
    job["data"]["file"] = source_folder() + "/configs/data/pendulum_motor/swing.csv";
    job["data"]["inputs"]["file"] = job["data"]["file"];
    return job;
}

json result_of(const json& job) {
    const TemporaryFolder folder;
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    return read_json(folder.path() / "out" / "result.json");
}

}  // namespace

TEST_CASE("the second half of a swing-up is predicted from the first", "[apps][run]") {
    const json result = result_of(motor_job());
    CHECK(result["status"] == "converged");
    REQUIRE(result["prediction"].size() == 4);
    // Published parameters leave 0.878 rad, one piece without limit and delay 0.053 rad; measured 0.0265 rad.
    CHECK(result["prediction"][3]["rms"]["angle"] < 0.03);
    const double inertia = result["parameters"]["inertia"]["value"];
    const double weight = result["parameters"]["weight"]["value"];
    CHECK(weight / inertia > 18.0);
    CHECK(weight / inertia < 22.0);
}

TEST_CASE("a strategy without a choice by hand gives a sensible pendulum", "[apps][run]") {
    json job = motor_job();
    // The published law from its published values.
    job["model"]["equations"]["rate"] =
        "(torque - offset - weight * sin(angle) - viscous * rate - dry * sign(rate)) / inertia";
    job["model"]["parameters"].erase("limit");
    job["estimate"]["parameters"].erase("limit");
    job["estimate"]["parameters"] = {{"inertia", {{"start", 0.06259}}},
                                     {"weight", {{"start", 1.0026}}},
                                     {"viscous", {{"start", 0.04707}}},
                                     {"dry", {{"start", 0.1839}}},
                                     {"offset", {{"start", -0.07586}}}};
    job["estimate"]["residuals"] = json::array({{{"type", "series"}}});
    job["estimate"]["strategy"] = "auto";
    const json result = result_of(job);
    const double inertia = result["parameters"]["inertia"]["value"];
    const double weight = result["parameters"]["weight"]["value"];
    CAPTURE(inertia, weight);
    CHECK(result["matching"][0]["interval"] >= 20);
    CHECK(weight / inertia > 15.0);
    CHECK(weight / inertia < 25.0);
    CHECK(inertia > 0.05);
    CHECK(inertia < 0.5);
}

}  // namespace pendulum_motor_test
