// Runs that are killed or interrupted, as processes of their own: signals come when a stage has told that it is done.

#include <csignal>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tests/apps/program/process.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace going_on_test {

using namespace orbid::tests;

namespace {

/// Three stages of a strategy, then another model beside the job's.
json staged_job() {
    json job = pendulum_job(16384);
    job["orbits"]["periods"] = {1, 2};
    job["estimate"]["strategy"] = {"prediction", "cycles", "harvest"};
    job["estimate"]["criticism"] = {{"without", {"k3"}}};
    return job;
}

/// A series with nodes, whose matching is lowered in stages within one estimate.
json series_job() {
    return json::parse(R"({
      "model": { "name": "henon", "parameters": { "a": 1.4, "b": 0.3 } },
      "seed": 3,
      "data": { "name": "run1", "simulate": { "sections": 400, "noise": { "x": 1e-3, "y": 1e-3 }, "trajectories": 2,
                                              "initial": [[0.1, 0.1], [0.2, 0.1]], "transient": 100 } },
      "estimate": { "parameters": { "a": { "start": 1.54 }, "b": { "start": 0.27 } }, "strategy": "auto" } })");
}

/// Starts, marginals, a profile and a sample of the posterior.
json explored_job() {
    json job = json::parse(orbid::apps::read_whole_file(orbid::tests::source_folder() + "/configs/hare_lynx.json"),
                           nullptr, true, true);
    job["data"]["file"] = orbid::tests::source_folder() + "/configs/" + job["data"]["file"].get<std::string>();
    job["estimate"]["multi_start"] = {{"starts", 3}};
    job["estimate"]["profile"] = {"alpha"};
    job["estimate"]["posterior"]["sample"] = {{"draws", 50}, {"chains", 2}, {"warm_up", 50}};
    return job;
}

/// Files that do not tell of times.
std::map<std::string, std::string> results(const Path& folder) {
    auto files = content(folder);
    files.erase("timing.json");
    files.erase("log.txt");
    files.erase("report.html");  // shows the times
    return files;
}

void check_same(const Path& folder, const Path& expected) {
    const auto found = results(folder);
    const auto wanted = results(expected);
    for (const auto& [name, bytes] : wanted) {
        CAPTURE(name);
        REQUIRE(found.count(name) == 1);
        CHECK((found.at(name) == bytes));
    }
    // No checkpoint and no temporary is left.
    CHECK(found.size() == wanted.size());
}

/// One run that nothing disturbs.
Path undisturbed(const Path& folder, const Path& file) {
    const Path out = folder / "undisturbed";
    const Outcome run = orbid_with({"run", file, "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    REQUIRE_FALSE(std::filesystem::exists(out / "checkpoint.bin"));
    return out;
}

/// A line of the stage says so.
bool is_reused(const std::string& text, const std::string& stage) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);)
        if (line.starts_with(stage + " ") && line.find("reused") != std::string::npos) return true;
    return false;
}

/// Killed when each of the stages has told that it is done, every time going on from the last one.
void kill_after(const Path& folder, const Path& file, const std::vector<std::string>& stages) {
    const Path expected = undisturbed(folder, file);
    const Path out = folder / "killed";
    for (std::size_t i = 0; i < stages.size(); ++i) {
        CAPTURE(stages[i]);
        Process run({"run", file, "--out", out, "--progress", "3600"});  // one line a stage: that of its end
        REQUIRE(run.reads(stages[i] + " "));
        run.send(SIGKILL);
        const int code = run.end();
        CAPTURE(run.text());
        // Whoever is killed just after the last stage may have ended by itself.
        REQUIRE((code == -SIGKILL || (i + 1 == stages.size() && code == 0)));
        // What was done before is taken up, and nothing else.
        for (std::size_t before = 0; before < i; ++before) {
            CAPTURE(stages[before]);
            CHECK(is_reused(run.text(), stages[before]));
        }
    }
    Process last({"run", file, "--out", out});
    CHECK(last.end() == 0);
    CAPTURE(last.text());
    check_same(out, expected);
}

}  // namespace

TEST_CASE("a run killed after each of its stages ends with the same bytes", "[apps][going_on]") {
    const TemporaryFolder folder;
    kill_after(folder.path(), write_job(folder.path() / "job.json", staged_job()),
               {"simulate", "orbits", "prediction", "cycles", "harvest", "criticism"});
}

TEST_CASE("a series killed after its stages ends with the same bytes", "[apps][going_on]") {
    const TemporaryFolder folder;
    kill_after(folder.path(), write_job(folder.path() / "job.json", series_job()),
               {"simulate", "prediction", "series"});
}

TEST_CASE("a run killed while it explores the posterior ends with the same bytes", "[apps][going_on]") {
    const TemporaryFolder folder;
    kill_after(folder.path(), write_job(folder.path() / "job.json", explored_job()),
               {"profile", "marginals", "posterior"});
}

TEST_CASE("a run killed while it draws records anew ends with the same bytes", "[apps][going_on][bootstrap]") {
    const TemporaryFolder folder;
    json job = explored_job();
    job["estimate"].erase("multi_start");
    job["estimate"].erase("marginals");
    job["estimate"].erase("posterior");
    job["estimate"]["intervals"] = {{"bootstrap", 400}};
    const Path file = write_job(folder.path() / "job.json", job);
    const Path expected = undisturbed(folder.path(), file);
    CHECK(content(expected).count("bootstrap.csv") == 1);
    // Interrupted among the replicates, then killed after them.
    const Path out = folder.path() / "interrupted";
    Process run({"run", file, "--out", out, "--progress", "3600"});
    REQUIRE(run.reads("profile "));
    run.send(SIGINT);
    CHECK(run.end() == 130);
    Process again({"run", file, "--out", out, "--progress", "3600"});
    REQUIRE(again.reads("intervals "));
    again.send(SIGKILL);
    (void)again.end();
    Process last({"run", file, "--out", out});
    CHECK(last.end() == 0);
    CAPTURE(last.text());
    check_same(out, expected);
}

TEST_CASE("interrupted after each of its stages, a run stores the best so far and goes on", "[apps][going_on]") {
    const TemporaryFolder folder;
    const Path file = write_job(folder.path() / "job.json", staged_job());
    const Path expected = undisturbed(folder.path(), file);
    const Path out = folder.path() / "interrupted";
    std::size_t stages = 0;
    for (const std::string stage : {"simulate", "orbits", "prediction", "cycles"}) {
        CAPTURE(stage);
        Process run({"run", file, "--out", out, "--progress", "3600"});  // one line a stage: that of its end
        REQUIRE(run.reads(stage + " "));
        run.send(stage == "orbits" ? SIGTERM : SIGINT);
        CHECK(run.end() == 130);
        CAPTURE(run.text());
        const json result = read_json(out / "result.json");
        CHECK(result["format"] == "orbid-result/1");
        CHECK(result["status"] == "interrupted");
        if (stage == "cycles") {
            // The lengths of stages before stand in the result, and in the answer.
            CHECK(result["stages"].size() >= 2);
            CHECK(std::abs(result["parameters"]["l"]["value"].get<double>() / 0.317 - 1.0) < 0.01);
        }
        stages += 1;
    }
    REQUIRE(stages == 4);
    Process last({"run", file, "--out", out});
    CHECK(last.end() == 0);
    CAPTURE(last.text());
    check_same(out, expected);
}

TEST_CASE("an interrupted simulation is left at once", "[apps][going_on]") {
    const TemporaryFolder folder;
    json job = pendulum_job();
    // A minute of work on four cores.
    job["data"]["simulate"]["sections"] = 20000000;
    const Path out = folder.path() / "out";
    Process run({"run", write_job(folder.path() / "job.json", job), "--out", out});
    while (!std::filesystem::exists(out))
        ::usleep(1000);
    run.send(SIGINT);
    CHECK(run.end() == 130);
    CHECK_THAT(run.text(), ContainsSubstring("interrupted"));
    CHECK(run.text().find("points in") == std::string::npos);  // it has not been simulated to its end
    CHECK(read_json(out / "result.json")["status"] == "interrupted");
    CHECK(std::filesystem::exists(out / "job.json"));
}

TEST_CASE("a second signal ends a run at once", "[apps][going_on]") {
    const TemporaryFolder folder;
    json job = explored_job();
    job["estimate"]["posterior"]["sample"] = {{"draws", 1000000}, {"chains", 2}, {"warm_up", 50}};
    const Path out = folder.path() / "out";
    Process run({"run", write_job(folder.path() / "job.json", job), "--out", out});
    REQUIRE(run.reads("marginals "));
    // Both arrive before the program does anything else.
    run.send(SIGSTOP);
    run.send(SIGINT);
    run.send(SIGTERM);
    run.send(SIGCONT);
    const int code = run.end();
    CHECK((code == -SIGTERM || code == -SIGINT));
    // What was stored before is whole.
    CHECK(read_json(out / "result.json")["status"] == "converged");
}

TEST_CASE("a checkpoint of another job or a damaged one is not taken up", "[apps][going_on]") {
    const TemporaryFolder folder;
    json job = explored_job();
    const Path file = write_job(folder.path() / "job.json", job);
    const Path expected = undisturbed(folder.path(), file);
    const Path out = folder.path() / "out";
    {
        Process run({"run", file, "--out", out, "--progress", "3600"});  // one line a stage: that of its end
        REQUIRE(run.reads("profile "));
        run.send(SIGKILL);
        run.end();
    }
    const std::string kept = orbid::apps::read_whole_file(out / "checkpoint.bin");
    REQUIRE(kept.size() > 1000);
    std::string changed = kept;
    changed[changed.size() / 2] = static_cast<char>(changed[changed.size() / 2] ^ 1);
    for (const std::string& bytes : {changed, kept.substr(0, kept.size() / 2), std::string("x")}) {
        CAPTURE(bytes.size());
        write_text(out / "checkpoint.bin", bytes);
        Process run({"run", file, "--out", out, "--progress", "3600"});  // one line a stage: that of its end
        CHECK(run.end() == 0);
        CHECK(run.text().find("reused") == std::string::npos);
        check_same(out, expected);
    }
    // Another seed: its sample is another one, and so is its job.
    job["seed"] = 77;
    const Path other = write_job(folder.path() / "other.json", job);
    write_text(out / "checkpoint.bin", kept);
    Process run({"run", other, "--out", out, "--force"});
    CHECK(run.end() == 0);
    CHECK(run.text().find("reused") == std::string::npos);
}

}  // namespace going_on_test
