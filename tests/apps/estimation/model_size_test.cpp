// Models whose dimension is chosen: what a job says, what is refused, what is listed, and a run.

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/starting/model_listing.hpp"
#include "apps/program/starting/starting_job.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace model_size_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;

namespace {

std::string job_of(const std::string& model, const std::string& initial) {
    return "{ \"model\": " + model +
           ", \"data\": { \"simulate\": { \"samples\": { \"step\": 0.1, \"count\": 11 }, \"initial\": [" + initial +
           "] } } }";
}

/// A state of the default size.
const std::string forty = [] {
    std::string state = "[2";
    for (int i = 1; i < 40; ++i)
        state += ", 1";
    return state + "]";
}();

}  // namespace

TEST_CASE("a job chooses the size of a model", "[apps][job]") {
    const std::string text =
        job_of(R"({ "name": "lorenz96", "size": 5, "parameters": { "F": 6 } })", "[1, 2, 3, 4, 5]");
    REQUIRE(problems(text).empty());
    const Job job = *read_job(text, job_folder / "job.json").job;
    REQUIRE(job.model.system->dimension() == 5);
    CHECK(job.model.size == 5);
    CHECK(job.model.values[0] == 6.0);
    // What is written says the size, and reads back as the same job.
    const std::string written = job_text(job, job_folder, {});
    CHECK_THAT(written, ContainsSubstring("\"size\": 5"));
    const auto again = read_job(written, job_folder / "job.json");
    REQUIRE(again.job);
    CHECK(again.job->model.size == 5);
    CHECK(job_text(*again.job, job_folder, {}) == written);

    // The default is written out too; a model without sizes says nothing of them.
    const auto standard = read_job(job_of(R"({ "name": "lorenz96" })", forty), job_folder / "job.json");
    REQUIRE(standard.job);
    CHECK(standard.job->model.size == 40);
    CHECK_THAT(job_text(*standard.job, job_folder, {}), ContainsSubstring("\"size\": 40"));
    const auto fixed = read_job(job_of(R"({ "name": "lotka_volterra" })", "[30, 4]"), job_folder / "job.json");
    REQUIRE(fixed.job);
    CHECK_FALSE(fixed.job->model.size);
    CHECK_THAT(job_text(*fixed.job, job_folder, {}), !ContainsSubstring("\"size\""));
}

TEST_CASE("a wrong size is refused", "[apps][job]") {
    check_only(job_of(R"({ "name": "lotka_volterra", "size": 3 })", "[30, 4]"),
               "/model/size: the number of coordinates of lotka_volterra is part of its equations");
    for (const char* size : {"3", "0", "-1", "10001", "4.5", "1e9"})
        check_only(job_of(std::string(R"({ "name": "lorenz96", "size": )") + size + " }", forty),
                   "/model/size: must be a whole number");
    check_only(job_of(R"({ "name": "lorenz96", "size": "4" })", forty), "/model/size: must be a whole number");
    // The rest of the job is checked with the standard size.
    const auto both = problems(job_of(R"({ "name": "lorenz96", "size": 3, "parameters": { "G": 1 } })", forty));
    CAPTURE(both);
    REQUIRE(both.size() == 2);
    CHECK_THAT(both[0], ContainsSubstring("/model/size: must be a whole number"));
    CHECK_THAT(both[1], ContainsSubstring("/model/parameters"));
    check_only(job_of(R"({ "name": "lorenz96", "sise": 40 })", forty), "did you mean \"size\"?");
    check_only(job_of(R"({ "name": "lorenz96", "size": 4 })", "[1, 2, 3]"), "[x1, x2, x3, x4]");
}

TEST_CASE("models of any size are listed and started", "[apps][command]") {
    const std::string page = model_page("lorenz96");
    CHECK_THAT(page, ContainsSubstring("size:         4 to 10000, \"size\" in a job (default 40)\n") &&
                         ContainsSubstring("coordinates:  x1 ... x40 [1]\n") &&
                         ContainsSubstring("kind:         autonomous\n") && !ContainsSubstring("symmetry"));
    CHECK_THAT(model_page("parametric_pendulum"),
               !ContainsSubstring("size:") && ContainsSubstring("sensors:      state function angle_difference\n"));
    CHECK_THAT(model_page("duffing"),
               ContainsSubstring("symmetry:     (x, x_dot) -> (-x, -x_dot), half a period later\n"));
    for (const std::string task : {"simulate", "series", "waveform"}) {
        const std::string text = starting_job("lorenz96", task);
        CAPTURE(text);
        CHECK_THAT(text, ContainsSubstring("\"size\": 6,") && ContainsSubstring("x1 ... x6"));
        CHECK(problems(text).empty());
    }
}

TEST_CASE("the forcing of a small ring is estimated from its series", "[apps][run]") {
    const tests::TemporaryFolder scratch;
    const auto file = tests::write_text(scratch.path() / "ring.json", R"({
      "model": { "name": "lorenz96", "size": 5, "parameters": { "F": 8 } }, "seed": 3,
      "data": { "name": "run1", "simulate": { "samples": { "step": 0.05, "count": 41 }, "initial": [[2, 1, 1, 1, 1]],
                "noise": { "x1": 0.01, "x2": 0.01, "x3": 0.01, "x4": 0.01, "x5": 0.01 } } },
      "estimate": { "parameters": { "F": { "start": 8.4 } }, "residuals": [ { "type": "series" } ] } })");
    const auto out = scratch.path() / "out";
    const tests::Outcome run = tests::orbid_with({"run", file.string(), "--out", out.string(), "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const auto result = tests::read_json(out / "result.json");
    const double value = result["parameters"]["F"]["value"], sd = result["parameters"]["F"]["sd"];
    CHECK(std::abs(value - 8.0) < 4.0 * sd);
    // 205 readings with a sd of 0.01 each: far below the size of the start's error.
    CHECK(sd < 0.02);
    CHECK(tests::read_json(out / "job.json")["model"]["size"] == 5);
    const auto again = scratch.path() / "again";
    REQUIRE(tests::orbid_with({"run", (out / "job.json").string(), "--out", again.string(), "--quiet"}).code == 0);
    CHECK(apps::read_whole_file(out / "result.json") == apps::read_whole_file(again / "result.json"));
}

}  // namespace model_size_test
