// What a second run takes from the folder, what it refuses, and that a stored job repeats its run.

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace run_reuse_test {

using namespace orbid::tests;

namespace {

std::map<std::string, bool> reused(const Path& out) {
    std::map<std::string, bool> stages;
    const json timing = read_json(out / "timing.json");
    for (const json& stage : timing["stages"])
        stages[stage["stage"]] = stage["reused"];
    return stages;
}

std::map<std::string, std::string> results(const Path& out) {
    auto files = content(out);
    files.erase("timing.json");
    files.erase("log.txt");
    files.erase("report.html");  // shows the times
    return files;
}

}  // namespace

TEST_CASE("a second run takes the finished stages from the folder", "[apps][run]") {
    const TemporaryFolder folder;
    for (const char* format : {"h5", "csv"}) {
        CAPTURE(format);
        json job = pendulum_job();
        job["output"] = {{"series", format}};
        const Path file = write_job(folder.path() / "job.json", job);
        const Path out = folder.path() / format;
        REQUIRE(orbid_with({"run", file, "--out", out}).code == 0);
        REQUIRE(std::filesystem::exists(out / (std::string("series.") + format)));
        CHECK_FALSE(reused(out)["simulate"]);
        CHECK_FALSE(reused(out)["orbits"]);
        const auto first = results(out);
        REQUIRE(orbid_with({"run", file, "--out", out}).code == 0);
        CHECK(reused(out)["simulate"]);
        CHECK(reused(out)["orbits"]);
        CHECK((results(out) == first));
    }
    // The format of the series is no matter of its numbers.
    CHECK(read_json(folder.path() / "h5" / "cycles.json")["cycles"] ==
          read_json(folder.path() / "csv" / "cycles.json")["cycles"]);
}

TEST_CASE("the stored job repeats the run", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Path other = folder.path() / "other";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", pendulum_job()), "--out", out}).code == 0);
    REQUIRE(orbid_with({"run", out / "job.json", "--out", other}).code == 0);
    CHECK((results(out) == results(other)));
}

TEST_CASE("single stages build on one another", "[apps][run]") {
    const TemporaryFolder folder;
    const Path job = write_job(folder.path() / "job.json", pendulum_job());
    const Path whole = folder.path() / "whole";
    const Path steps = folder.path() / "steps";
    REQUIRE(orbid_with({"run", job, "--out", whole}).code == 0);
    REQUIRE(orbid_with({"simulate", job, "--out", steps}).code == 0);
    CHECK(std::filesystem::exists(steps / "series.h5"));
    CHECK_FALSE(std::filesystem::exists(steps / "cycles.json"));
    REQUIRE(orbid_with({"orbits", job, "--out", steps}).code == 0);
    CHECK(reused(steps)["simulate"]);
    CHECK_FALSE(std::filesystem::exists(steps / "result.json"));
    REQUIRE(orbid_with({"estimate", job, "--out", steps}).code == 0);
    CHECK(reused(steps)["orbits"]);
    CHECK((results(whole) == results(steps)));
}

TEST_CASE("a folder with the result of another job is refused and unchanged", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", pendulum_job()), "--out", out}).code == 0);
    const auto before = content(out);
    json other = pendulum_job();
    other["seed"] = 2;
    const Path file = write_job(folder.path() / "other.json", other);
    for (const char* command : {"run", "simulate", "orbits", "estimate"}) {
        CAPTURE(command);
        const Outcome refused = orbid_with({command, file, "--out", out});
        CHECK(refused.code == 2);
        CHECK(refused.out.empty());
        CHECK_THAT(refused.error, ContainsSubstring(out.string()) && ContainsSubstring("/seed is 1 there, 2") &&
                                      ContainsSubstring("--force"));
        CHECK((content(out) == before));
    }

    // With --force a later stage alone still needs the earlier ones of this very job, and says which key differs.
    for (const char* command : {"orbits", "estimate"}) {
        CAPTURE(command);
        const Outcome stale = orbid_with({command, file, "--out", out, "--force"});
        CHECK(stale.code == 2);
        CHECK_THAT(stale.error, ContainsSubstring("series.h5") && ContainsSubstring("/seed is 1 in the file, 2 in"));
        CHECK((content(out) == before));
    }

    // The first stage alone replaces the series; nothing of the other job's results may stay and look like ours.
    REQUIRE(orbid_with({"simulate", file, "--out", out, "--force"}).code == 0);
    CHECK_FALSE(std::filesystem::exists(out / "result.json"));
    CHECK_FALSE(std::filesystem::exists(out / "residuals.csv"));
    const Outcome stale = orbid_with({"estimate", file, "--out", out});
    CHECK(stale.code == 2);
    CHECK_THAT(stale.error, ContainsSubstring("cycles.json") && ContainsSubstring("/seed is 1 in the file, 2 in"));
    CHECK(orbid_with({"run", file, "--out", out}).code == 0);
    CHECK(reused(out)["simulate"]);
    CHECK_FALSE(reused(out)["orbits"]);
}

TEST_CASE("cycles are taken from the file of an earlier run", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", pendulum_job()), "--out", out}).code == 0);
    json job = pendulum_job();
    job.erase("data");
    job["orbits"] = {{"file", "out/cycles.json"}};
    job["estimate"]["residuals"][0]["periods"] = {1, 2, 3};
    const Path again = folder.path() / "again";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "again.json", job), "--out", again});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json first = read_json(out / "result.json");
    const json second = read_json(again / "result.json");
    // The same numbers go in, so the same come out, to the last bit.
    CHECK(first["parameters"] == second["parameters"]);
    CHECK(first["errors"] == second["errors"]);
    CHECK(second["data"]["points"] == 0);
    const json stored = read_json(again / "job.json");
    CHECK(stored.dump().find("sha256") != std::string::npos);

    // The stored job wants that very file.
    std::string text = orbid::apps::read_whole_file(out / "cycles.json");
    write_text(out / "cycles.json", text + "\n");
    const auto before = content(again);
    const Outcome changed = orbid_with({"run", again / "job.json", "--out", folder.path() / "third"});
    CHECK(changed.code == 3);
    CHECK_THAT(changed.error, ContainsSubstring("cycles.json") && ContainsSubstring("SHA-256"));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "third"));
}

}  // namespace run_reuse_test
