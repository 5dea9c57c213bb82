// Data that cannot be used: each with the place, the rule and code 3, and nothing left behind.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace bad_data_test {

using namespace orbid::tests;

namespace {

/// Samples of an angle in ten rows, one of which may be replaced by another text.
std::string samples(int row = -1, const std::string& text = "") {
    std::string table = "t,theta\n";
    for (int i = 0; i < 10; ++i)
        table += i == row ? text + "\n" : fmt::format("{},{}\n", 0.1 * i, 0.01 * i);
    return table;
}

json samples_job() {
    return json::parse(R"({ "model": { "name": "free_pendulum" },
      "data": { "file": "data.csv", "kind": "samples", "columns": { "time": "t", "phi": "theta" } },
      "estimate": { "parameters": { "w0sq": { "start": 60 } }, "residuals": [ { "type": "series" } ] } })");
}

json section_job() {
    json job = pendulum_job();
    job["data"] =
        json::parse(R"({ "file": "data.csv", "kind": "section", "columns": { "phi": "phi", "phi_dot": "phi_dot" } })");
    return job;
}

/// Runs the job beside `data.csv`: refused with code 3 before anything is stored.
std::string refused(const json& job, const std::string& data) {
    const TemporaryFolder folder;
    write_text(folder.path() / "data.csv", data);
    write_job(folder.path() / "job.json", job);
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", folder.path() / "job.json", "--out", out, "--quiet"});
    CHECK(run.code == 3);
    CHECK(run.out.empty());
    CHECK_FALSE(std::filesystem::exists(out));
    return run.error;
}

}  // namespace

TEST_CASE("a table that cannot be read is refused by file, line and column", "[apps][data]") {
    struct Row {
        std::string data;
        std::vector<std::string> words;
    };
    // Row i of the table stands in line i + 2.
    const std::vector<Row> rows{
        {samples(3, "0.3,abc"), {"data.csv:5", "theta", "\"abc\" is not a number", "empty cell"}},
        {samples(3, "0.3,nan"), {"data.csv:5", "theta", "\"nan\" is not a finite number", "empty cell"}},
        {samples(3, "0.3,inf"), {"data.csv:5", "theta", "\"inf\" is not a finite number"}},
        {samples(3, "0.3,-Infinity"), {"data.csv:5", "theta", "not a finite number"}},
        {samples(3, "0.3,1e999"), {"data.csv:5", "theta", "\"1e999\" is outside the range"}},
        {samples(3, "nan,0.3"), {"data.csv:5", "t"}},
        {samples(3, "0.3"), {"data.csv:5", "1", "2"}},
        {samples(3, "0.3,0.1,7"), {"data.csv:5", "3", "2"}},
        {samples(3, "0.1,0.03"), {"data.csv:5", "must ascend"}},
        {samples(3, "0.33,0.03"), {"data.csv", "must be equidistant"}},
        {"", {"data.csv"}},
        {"t,theta\n", {"data.csv", "no rows"}},
        {"t,theta\n0,1\n", {"data.csv", "1 point", "2"}},
        {"t,phi\n0,1\n1,2\n", {"data.csv", "theta"}},
        {"t,theta,theta\n0,1,1\n1,2,2\n", {"data.csv", "theta", "twice"}},
    };
    for (const Row& row : rows) {
        CAPTURE(row.data);
        const std::string message = refused(samples_job(), row.data);
        for (const std::string& word : row.words)
            CHECK_THAT(message, ContainsSubstring(word));
        // One line for people, no exception text of a library.
        CHECK(std::count(message.begin(), message.end(), '\n') == 1);
    }
}

TEST_CASE("nan is a missing sample where the job says so", "[apps][data]") {
    const TemporaryFolder folder;
    std::string table = "t,theta\n";
    for (int i = 0; i < 200; ++i) {
        const double t = 0.01 * i;
        table += i == 7 ? fmt::format("{},nan\n", t) : fmt::format("{},{}\n", t, 0.01 * std::cos(7.7 * t));
    }
    write_text(folder.path() / "data.csv", table);
    json job = samples_job();
    job["data"]["missing"] = "nan";
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    CHECK(run.code == 0);
    // cos(7.7 t) of small amplitude: w0sq = 7.7^2, the pendulum's own 1 - a^2 / 8 below 2e-5.
    const json result = read_json(out / "result.json");
    CHECK_THAT(result["parameters"]["w0sq"]["value"].get<double>(), WithinRel(7.7 * 7.7, 1e-4));
    CHECK(result["errors"].begin()->at("count") == 199);
}

TEST_CASE("the unit of the time column counts", "[apps][data]") {
    const TemporaryFolder folder;
    std::string table = "t,theta\n";
    for (int i = 0; i < 200; ++i)
        table += fmt::format("{},{}\n", 10 * i, 0.01 * std::cos(7.7 * 0.01 * i));
    write_text(folder.path() / "data.csv", table);
    json job = samples_job();
    job["data"]["columns"]["time"] = {{"column", "t"}, {"unit", "ms"}};
    const Path out = folder.path() / "out";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out}).code == 0);
    CHECK_THAT(read_json(out / "result.json")["parameters"]["w0sq"]["value"].get<double>(), WithinRel(7.7 * 7.7, 1e-4));
}

TEST_CASE("a series too short for cycles is refused", "[apps][data]") {
    std::string table = "phi,phi_dot\n";
    CHECK_THAT(refused(section_job(), table + "0.1,0.2\n"), ContainsSubstring("1 point"));
    for (int i = 0; i < 3; ++i)
        table += fmt::format("{},{}\n", 0.1 * i, 0.2 * i);
    CHECK_THAT(refused(section_job(), table), ContainsSubstring("cannot be searched for cycles"));
}

TEST_CASE("samples fewer than what is to be determined are refused", "[apps][data]") {
    // Two readings cannot determine an initial state of two coordinates and a parameter.
    CHECK_THAT(refused(samples_job(), "t,theta\n0,1\n0.01,0.99\n"),
               ContainsSubstring("too short: 2 readings") && ContainsSubstring("at least"));
}

TEST_CASE("a coordinate without spread is refused", "[apps][data]") {
    std::string table = "phi,phi_dot\n";
    for (int i = 0; i < 500; ++i)
        table += fmt::format("{},2\n", 0.001 * i);
    CHECK_THAT(refused(section_job(), table),
               ContainsSubstring("cannot be searched for cycles") && ContainsSubstring("phi_dot"));
}

TEST_CASE("a missing file is refused before anything is made", "[apps][data]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", samples_job()), "--out", out});
    CHECK(run.code == 3);
    CHECK_THAT(run.error,
               ContainsSubstring("/data/file") && ContainsSubstring("data.csv") && ContainsSubstring("does not exist"));
    CHECK_FALSE(std::filesystem::exists(out));
    json job = pendulum_job();
    job["orbits"] = {{"file", "none.json"}};
    const Outcome cycles = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CHECK(cycles.code == 3);
    CHECK_THAT(cycles.error, ContainsSubstring("/orbits/file") && ContainsSubstring("none.json"));
}

TEST_CASE("a file that is no list of cycles is refused", "[apps][data]") {
    const TemporaryFolder folder;
    json job = pendulum_job();
    job.erase("data");
    job["orbits"] = {{"file", "cycles.json"}};
    write_job(folder.path() / "job.json", job);
    for (const std::string text : {"", "{", R"({ "format": "orbid-cycles/1", "cycles": [ { "period": 2 } ] })"}) {
        CAPTURE(text);
        write_text(folder.path() / "cycles.json", text);
        const Outcome run = orbid_with({"run", folder.path() / "job.json", "--out", folder.path() / "out"});
        CHECK(run.code == 3);
        CHECK_THAT(run.error, ContainsSubstring("cycles.json"));
        CHECK_FALSE(std::filesystem::exists(folder.path() / "out"));
    }
}

TEST_CASE("bad data leave earlier results as they are, and better data are accepted", "[apps][data]") {
    const TemporaryFolder folder;
    const Path job = write_job(folder.path() / "job.json", samples_job());
    const Path out = folder.path() / "out";
    std::string good = "t,theta\n";
    for (int i = 0; i < 200; ++i)
        good += fmt::format("{},{}\n", 0.01 * i, 0.01 * std::cos(7.7 * 0.01 * i));
    write_text(folder.path() / "data.csv", samples(3, "0.3,abc"));
    CHECK(orbid_with({"run", job, "--out", out}).code == 3);
    write_text(folder.path() / "data.csv", good);
    CHECK(orbid_with({"run", job, "--out", out}).code == 0);
    const auto before = content(out);
    write_text(folder.path() / "data.csv", samples(3, "0.3,abc"));
    CHECK(orbid_with({"run", job, "--out", out}).code == 2);  // other data are another job
    CHECK((content(out) == before));
    CHECK(orbid_with({"run", job, "--out", out, "--force"}).code == 3);
    CHECK((content(out) == before));
}

TEST_CASE("a place where nothing can be stored is refused before computing", "[apps][data]") {
    const TemporaryFolder folder;
    const Path job = write_job(folder.path() / "job.json", pendulum_job());
    const Path taken = write_text(folder.path() / "taken", "mine");
    Outcome run = orbid_with({"run", job, "--out", taken, "--force"});
    CHECK(run.code == 2);
    CHECK_THAT(run.error, ContainsSubstring(taken.string()) && ContainsSubstring("is not a folder"));
    run = orbid_with({"run", job, "--out", taken / "below"});
    CHECK(run.code == 2);
    CHECK_THAT(run.error, ContainsSubstring((taken / "below").string()));
    CHECK(orbid::apps::read_whole_file(taken) == "mine");
}

}  // namespace bad_data_test
