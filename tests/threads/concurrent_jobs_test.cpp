// Whole jobs by several threads of one program, each into a folder of its own: the bytes that each gives alone.

#include <fmt/format.h>

#include "apps/program/job_run.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/threads/at_once.hpp"

using namespace orbid;
using namespace orbid::tests;

namespace {

/// Jobs of different kinds beside each other: cycles of simulated sections; an interpreted model with its samples in
/// HDF5 and a posterior; orbits of the model alone; one that is refused.
std::string job_text(std::size_t k) {
    json job;
    switch (k % 4) {
        case 0:
            job = pendulum_job(4096);
            job["orbits"]["periods"] = {1, 2};
            break;
        case 1:
            job = json::parse(R"({
          "model": { "equations": { "x": "v", "v": "-c * v - x - b * x^3" }, "compile": false,
                     "parameters": { "c": 0.1, "b": 0.5 } },
          "data": { "simulate": { "samples": { "step": 0.1, "count": 60 }, "initial": [[1, 0], [0.4, 0.8]],
                                  "noise": { "x": { "sd": 0.01 } } }, "observe": ["x"] },
          "estimate": { "parameters": { "c": { "start": 0.12 }, "b": { "start": 0.4 } },
                        "residuals": [ { "type": "series", "interval": "segment" } ],
                        "posterior": { "sample": 40 } } })");
            break;
        case 2:
            job = json::parse(R"({
          "model": { "name": "parametric_pendulum" },
          "periodic": { "orbits": [ { "period": 1, "points": [[2.96, 6.40]] } ] } })");
            break;
        default:
            job = json::parse(R"({ "model": { "name": "henon", "parametres": {} }, "data": {} })");
    }
    job["seed"] = k + 1;
    return job.dump();
}

/// Everything that a job leaves or says, but for the times it took.
std::map<std::string, std::string> left_by(const Path& folder, std::size_t k, int threads) {
    apps::RunOptions options;
    options.out = folder / fmt::format("job{}", k);
    options.threads = threads;
    options.quiet = true;
    const apps::JobRun run = apps::run_job_text(job_text(k), folder / fmt::format("job{}.json", k), options);
    std::map<std::string, std::string> left;
    if (std::filesystem::exists(options.out)) left = content(options.out);
    for (const char* with_times : {"timing.json", "log.txt", "report.html"})
        left.erase(with_times);
    left["exit code"] = std::to_string(run.exit_code);
    left["result"] = run.result;
    for (const apps::JobProblem& problem : run.problems)
        left["problem " + problem.pointer] = problem.rule;
    return left;
}

}  // namespace

TEST_CASE("jobs by several callers at once", "[threads][concurrent][jobs]") {
    using Left = std::map<std::string, std::string>;
    constexpr std::size_t callers = 8;
    const TemporaryFolder together, alone;
    const auto results =
        at_once<Left>(callers, [&](std::size_t k) { return left_by(together.path(), k, k < callers / 2 ? 0 : 2); });
    for (std::size_t k = 0; k < callers; ++k) {
        CAPTURE(k);
        const Left expected = left_by(alone.path(), k, 1);
        CHECK(expected.at("exit code") == (k % 4 == 3 ? "2" : "0"));
        CHECK(expected.count(k % 4 == 3 ? "problem /model/parametres" : "job.json") == 1);
        REQUIRE(results[k].size() == expected.size());
        for (const auto& [name, text] : expected) {
            CAPTURE(name);
            REQUIRE(results[k].count(name) == 1);
            CHECK(results[k].at(name) == text);
        }
    }
}

TEST_CASE("one of several jobs is stopped", "[threads][concurrent][jobs]") {
    const TemporaryFolder folder;
    const auto codes = at_once<int>(4, [&](std::size_t k) {
        apps::RunOptions options;
        options.out = folder.path() / std::to_string(k);
        apps::JobRunCalls calls;
        if (k == 0) calls.stopped = [] { return true; };
        return apps::run_job_text(job_text(1), folder.path() / "job.json", options, calls).exit_code;
    });
    CHECK(codes == std::vector<int>{130, 0, 0, 0});
}
