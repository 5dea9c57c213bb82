#include "apps/program/job_run.hpp"

#include <algorithm>
#include <atomic>
#include <sstream>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace orbid::job_run_test {
namespace {

using tests::Path;
using tests::TemporaryFolder;

apps::RunOptions into(const Path& folder) {
    apps::RunOptions options;
    options.out = folder;
    return options;
}

/// Runs a job and fails when anything reached the streams of the process.
apps::JobRun silent_run(const std::string& job, const Path& source, const apps::RunOptions& options,
                        const apps::JobRunCalls& calls = {}) {
    const TemporaryFolder folder;
    tests::CaughtStream out(STDOUT_FILENO, folder.path() / "out");
    tests::CaughtStream error(STDERR_FILENO, folder.path() / "error");
    apps::JobRun run = apps::run_job_text(job, source, options, calls);
    REQUIRE(out.finish().empty());
    REQUIRE(error.finish().empty());
    return run;
}

TEST_CASE("a job given as text gives what the program gives, without printing", "[apps]") {
    const TemporaryFolder folder;
    const std::string job = tests::pendulum_job().dump(2);
    const Path file = tests::write_text(folder.path() / "job.json", job);
    const tests::Outcome program =
        tests::orbid_with({"run", file.string(), "--out", (folder.path() / "program").string()});
    REQUIRE(program.code == 0);

    std::vector<std::string> lines;
    apps::JobRunCalls calls;
    calls.messages = [&lines](std::string_view line) { lines.emplace_back(line); };
    const apps::JobRun run = silent_run(job, file, into(folder.path() / "library"), calls);
    CHECK(run.exit_code == 0);
    CHECK(run.problems.empty());
    CHECK(run.summary == program.out);
    CHECK(run.result == apps::read_whole_file(folder.path() / "program" / "result.json"));
    auto from_program = tests::content(folder.path() / "program"),
         from_library = tests::content(folder.path() / "library");
    for (const char* times : {"timing.json", "log.txt", "report.html"}) {
        from_program.erase(times);
        from_library.erase(times);
    }
    CHECK(from_program == from_library);

    std::string joined;
    for (const std::string& line : lines)
        joined += line + "\n";
    CHECK(joined == run.messages);
    CHECK_THAT(run.messages, tests::ContainsSubstring("orbits"));

    apps::RunOptions quiet = into(folder.path() / "quiet");
    quiet.quiet = true;
    quiet.threads = 1;
    const apps::JobRun alone = silent_run(job, file, quiet);
    CHECK(alone.messages.empty());
    CHECK(alone.result == run.result);
}

TEST_CASE("problems of a job given as text have pointer, line and rule", "[apps]") {
    const TemporaryFolder folder;
    const Path source = folder.path() / "never_written.json";
    const std::string job = R"({
  "model": { "name": "lorenz" },
  "data": { "simulate": { "sektions": 10 } }
})";
    const auto problems = apps::job_problems(job, source);
    REQUIRE(!problems.empty());
    CHECK(problems[0].pointer == "/data/simulate/sektions");
    CHECK(problems[0].line == 3);
    CHECK(problems[0].column == 27);
    CHECK(!problems[0].data);
    CHECK_THAT(problems[0].rule, tests::ContainsSubstring("sections"));
    CHECK_THAT(problems[0].text, tests::ContainsSubstring("never_written.json:3:27: /data/simulate/sektions: "));
    const apps::JobRun run = silent_run(job, source, into(folder.path() / "out"));
    CHECK(run.exit_code == 2);
    CHECK(run.problems.size() == problems.size());
    CHECK(!std::filesystem::exists(folder.path() / "out"));

    const auto missing = apps::job_problems(
        R"({ "model": { "name": "lorenz" }, "data": { "file": "none.csv", "kind": "samples" } })", source);
    const auto file = std::find_if(missing.begin(), missing.end(), [](const auto& problem) { return problem.data; });
    REQUIRE(file != missing.end());
    CHECK(file->pointer == "/data/file");
    CHECK_THAT(file->text, tests::ContainsSubstring("none.csv"));
}

TEST_CASE("a caller stops a run at its next step, with the best so far", "[apps]") {
    const TemporaryFolder folder;
    std::atomic<int> asked = 0;
    std::atomic<bool> twice = false;
    std::atomic<int> inside = 0;
    apps::JobRunCalls calls;
    calls.stopped = [&] {
        if (inside.fetch_add(1) > 0) twice = true;
        const bool stop = ++asked > 3;
        inside.fetch_sub(1);
        return stop;
    };
    const apps::JobRun run =
        silent_run(tests::pendulum_job().dump(), folder.path() / "job.json", into(folder.path() / "out"), calls);
    CHECK(run.exit_code == 130);
    CHECK(asked == 4);
    CHECK(!twice);
    CHECK(tests::json::parse(run.result).at("status") == "interrupted");
    CHECK(apps::read_whole_file(folder.path() / "out" / "result.json") == run.result);

    // The same job goes on to the end it would have had.
    const apps::JobRun rest =
        silent_run(tests::pendulum_job().dump(), folder.path() / "job.json", into(folder.path() / "out"));
    const apps::JobRun whole =
        silent_run(tests::pendulum_job().dump(), folder.path() / "job.json", into(folder.path() / "whole"));
    CHECK(rest.exit_code == 0);
    CHECK(rest.result == whole.result);
}

TEST_CASE("a run that does not begin gives no result of another job", "[apps]") {
    const TemporaryFolder folder;
    const Path source = folder.path() / "job.json";
    const apps::RunOptions options = into(folder.path() / "out");
    REQUIRE(silent_run(tests::pendulum_job(4096).dump(), source, options).exit_code == 0);
    const apps::JobRun refused = silent_run(tests::pendulum_job(8192).dump(), source, options);
    CHECK(refused.exit_code == 2);
    CHECK(refused.result.empty());
    CHECK_THAT(refused.messages, tests::ContainsSubstring("--force") || tests::ContainsSubstring("another job"));
    apps::RunOptions simulation = options;
    simulation.stage = apps::Stage::simulate;
    CHECK(silent_run(tests::pendulum_job(4096).dump(), source, simulation).result.empty());

    CHECK_THROWS_AS(apps::run_job_text("{}", source, apps::RunOptions{}), std::invalid_argument);
    apps::RunOptions threads = options;
    threads.threads = -1;
    CHECK_THROWS_AS(apps::run_job_text("{}", source, threads), std::invalid_argument);
}

TEST_CASE("what a caller's function throws comes out of the run, which has gone on to its end", "[apps]") {
    const TemporaryFolder folder;
    apps::JobRunCalls calls;
    int told = 0;
    calls.messages = [&told](std::string_view) {
        ++told;
        throw std::domain_error("enough");
    };
    CHECK_THROWS_AS(apps::run_job_text(tests::pendulum_job(4096).dump(), folder.path() / "job.json",
                                       into(folder.path() / "out"), calls),
                    std::domain_error);
    CHECK(told == 1);
    CHECK(tests::read_json(folder.path() / "out" / "result.json").at("status") == "converged");
}

TEST_CASE("commands write to the streams of their caller", "[apps]") {
    const TemporaryFolder folder;
    tests::CaughtStream caught(STDOUT_FILENO, folder.path() / "out");
    std::ostringstream out, error;
    CHECK(apps::run_command({"models", "lorenz"}, out, error) == 0);
    CHECK_THAT(out.str(), tests::ContainsSubstring("sigma"));
    CHECK(apps::run_command({"modles"}, out, error) == 2);
    CHECK_THAT(error.str(), tests::ContainsSubstring("models"));

    const Path file = tests::write_job(folder.path() / "job.json", tests::pendulum_job(4096));
    const auto run = [&](const std::string& name, const std::string& threads, const std::function<bool()>& stopped) {
        return apps::run_command({"run", file.string(), "--out", (folder.path() / name).string(), "--threads", threads},
                                 out, error, stopped);
    };
    CHECK(run("one", "1", {}) == 0);
    CHECK(run("two", "2", {}) == 0);
    CHECK(apps::read_whole_file(folder.path() / "one" / "result.json") ==
          apps::read_whole_file(folder.path() / "two" / "result.json"));
    CHECK(run("stopped", "2", [] { return true; }) == 130);
    CHECK(tests::read_json(folder.path() / "stopped" / "result.json").at("status") == "interrupted");
    CHECK_THAT(out.str(), tests::ContainsSubstring("converged"));
    CHECK(caught.finish().empty());
}

}  // namespace
}  // namespace orbid::job_run_test
