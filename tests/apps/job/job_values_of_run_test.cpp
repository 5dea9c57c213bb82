// "from" among the parameters of a model: the values of an earlier run.

#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_values_of_run_test {

using namespace orbid::apps;
using orbid::tests::ContainsSubstring;
using orbid::tests::json;
using orbid::tests::orbid_with;
using orbid::tests::Path;
using orbid::tests::problems;

namespace {

json swing() {
    return json::parse(R"({ "model": { "name": "free_pendulum", "parameters": { "w0sq": 61 } }, "seed": 2,
      "data": { "name": "run1", "simulate": { "samples": { "step": 0.02, "count": 101 }, "initial": [[1.5, 2]],
                                              "noise": { "phi": 0.001 } }, "observe": ["phi"] },
      "estimate": { "parameters": { "c2": { "start": 0.1 } }, "residuals": [ { "type": "series" } ] },
      "output": { "series": "none" } })");
}

std::string question(const std::string& parameters) {
    return R"({ "model": { "name": "free_pendulum", "parameters": )" + parameters + R"( },
  "data": { "simulate": { "samples": { "step": 0.1, "count": 3 } } } })";
}

double value(const Job& job, const char* name) {
    return job.model.values[job.model.system->parameter_index(name)];
}

}  // namespace

TEST_CASE("a model takes the values of an earlier run, and its own before them", "[apps][job]") {
    const orbid::tests::TemporaryFolder folder;
    REQUIRE(orbid_with({"run", orbid::tests::write_job(folder.path() / "swing.json", swing()), "--quiet"}).code == 0);
    const double c2 =
        orbid::tests::read_json(folder.path() / "swing" / "result.json")["parameters"]["c2"]["value"].get<double>();

    const std::string text = question(R"({ "from": "swing/result.json" })");
    const auto all = read_job(text, folder.path() / "question.json");
    REQUIRE(all.job);
    CHECK(value(*all.job, "c2") == c2);
    CHECK(value(*all.job, "w0sq") == 61.0);
    const auto own = read_job(question(R"({ "w0sq": 64, "from": "swing/result.json" })"), folder.path() / "q.json");
    REQUIRE(own.job);
    CHECK(value(*own.job, "c2") == c2);
    CHECK(value(*own.job, "w0sq") == 64.0);
    // The complete job has the numbers themselves: it means the same when the run is gone.
    const json complete = json::parse(job_text(*all.job, folder.path()));
    CHECK(complete["model"]["parameters"]["c2"] == c2);
    CHECK_FALSE(complete["model"]["parameters"].contains("from"));

    // Without its job a result tells the estimates alone.
    std::filesystem::rename(folder.path() / "swing" / "result.json", folder.path() / "result.json");
    const auto alone = read_job(question(R"({ "from": "result.json" })"), folder.path() / "q.json");
    REQUIRE(alone.job);
    CHECK(value(*alone.job, "c2") == c2);
    CHECK(value(*alone.job, "w0sq") != 61.0);

    // Equations state all their parameters; those of the run replace them.
    const auto equations = read_job(R"({ "model": { "name": "swing", "equations": { "x": "v", "v": "-c2 * v - q * x" },
        "parameters": { "from": "result.json", "c2": 1, "q": 4 } },
      "data": { "simulate": { "samples": { "step": 0.1, "count": 3 } } } })",
                                    folder.path() / "q.json");
    for (const Problem& problem : equations.problems)
        UNSCOPED_INFO(problem.pointer + ": " + problem.rule);
    REQUIRE(equations.job);
    CHECK(value(*equations.job, "c2") == c2);
    CHECK(value(*equations.job, "q") == 4.0);
}

TEST_CASE("values of a run that is none are refused", "[apps][job]") {
    const orbid::tests::TemporaryFolder folder;
    const auto refused = [&folder](const std::string& expected) {
        const auto found = problems(question(R"({ "from": "r.json" })"), folder.path());
        CAPTURE(found);
        REQUIRE(found.size() == 1);
        CHECK_THAT(found[0], ContainsSubstring("/model/parameters/from: ") && ContainsSubstring(expected));
        const auto job = orbid::tests::write_text(folder.path() / "q.json", question(R"({ "from": "r.json" })"));
        CHECK(orbid_with({"check", job}).code == 3);
    };
    refused("does not exist");
    const Path file = folder.path() / "r.json";
    orbid::tests::write_text(file, "{ \"format\": ");
    refused("is no file of the format orbid-result/1");
    orbid::tests::write_text(file, R"({ "format": "orbid-job/1", "parameters": { "c2": { "value": 1 } } })");
    refused("is no file of the format orbid-result/1");
    orbid::tests::write_text(file, R"({ "format": "orbid-result/1", "parameters": { "k9": { "value": 1 } } })");
    refused("has no parameter of the model free_pendulum");
    orbid::tests::write_text(file, R"({ "format": "orbid-result/1", "parameters": { "c2": { "value": null } } })");
    refused("has no parameter of the model free_pendulum");
    orbid::tests::write_text(file, R"({ "format": "orbid-result/1", "parameters": [1] })");
    refused("has no parameter of the model free_pendulum");
}

}  // namespace job_values_of_run_test
