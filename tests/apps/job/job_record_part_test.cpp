// Parts of a record in a job: what is read, written, run and refused.

#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_record_part_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::json;
using tests::orbid_with;
using tests::Path;
using tests::WithinAbs;

namespace {

/// A job for the table of the corpus, as text.
std::string job_with(const std::string& part, const std::string& columns = R"("time": "t", "phi": "theta")") {
    return R"({ "model": { "name": "free_pendulum" },
  "data": { "file": "../tests/apps/jobs/data/samples.csv", "kind": "samples", "columns": { )" +
           columns + " }, " + part + R"( },
  "estimate": { "parameters": { "c2": { "start": 0.1 } }, "residuals": [ { "type": "series" } ] } })";
}

/// A job for a table of sections of a forced model.
std::string section_job(const std::string& part) {
    return R"({ "model": { "name": "duffing" }, "orbits": { "periods": [1] },
  "data": { "file": "../tests/apps/jobs/data/samples.csv", "kind": "section",
            "columns": { "x": "theta", "x_dot": "sd" }, )" +
           part + " } }";
}

FileJob file_with(const std::string& part) {
    return tests::file_of(job_with(part));
}

/// The damping of a swing from the samples of run.csv.
json swing(const json& data) {
    json job = json::parse(R"({ "model": { "name": "free_pendulum", "parameters": { "c2": 0.05 } },
      "estimate": { "parameters": { "c2": { "start": 0.1 } },
                    "residuals": [ { "type": "series", "errors": { "phi": { "sd": 0.001 } } } ] } })");
    job["data"] = data;
    return job;
}

/// Runs a job in a folder of its own. @return the output folder.
Path run(const Path& folder, const std::string& name, const json& job) {
    const auto outcome = orbid_with({"run", tests::write_job(folder / (name + ".json"), job), "--quiet"});
    CAPTURE(outcome.error);
    REQUIRE(outcome.code == 0);
    return folder / name;
}

/// A swing of 401 samples, 0.01 s apart, as a table that a stranger might bring.
void write_record(const Path& folder) {
    const json simulated = json::parse(R"({ "model": { "name": "free_pendulum", "parameters": { "c2": 0.05 } },
      "seed": 3, "data": { "simulate": { "samples": { "step": 0.01, "count": 401 }, "initial": [[1.5, 2]],
                                         "noise": { "phi": 0.001 } } },
      "output": { "series": "csv" } })");
    std::filesystem::copy_file(run(folder, "simulated", simulated) / "series.csv", folder / "run.csv");
}

}  // namespace

TEST_CASE("window, rows, every and step of a record are read and written", "[apps][job]") {
    const FileJob whole = file_with(R"("every": 1)");
    CHECK(whole.part.every == 1);
    CHECK_FALSE(whole.part.windowed());
    CHECK(whole.evenly_spaced);
    const FileJob part = file_with(R"("window": [0.01, 2.5], "rows": [2, 7], "every": 3, "spacing": "any")");
    CHECK(part.part.begin == 0.01);
    CHECK(part.part.end == 2.5);
    CHECK(part.part.first_row == 2);
    CHECK(part.part.last_row == 7);
    CHECK(part.part.every == 3);
    CHECK_FALSE(part.evenly_spaced);
    const auto stepped = read_job(job_with(R"("step": 0.5)", R"("phi": "theta")"), tests::job_folder / "job.json");
    REQUIRE(stepped.job);
    CHECK(stepped.job->data[0].file->step == 0.5);
}

TEST_CASE("a part that the record cannot have is refused", "[apps][job]") {
    check_only(job_with(R"("window": [2, 1])"), "/data/window: [2, 1] must ascend");
    check_only(job_with(R"("window": [1])"), "/data/window");
    check_only(job_with(R"("rows": [5, 4])"), "/data/rows: [5, 4] must ascend");
    check_only(job_with(R"("rows": [0, 4])"), "/data/rows/0");
    check_only(job_with(R"("every": 0)"), "/data/every");
    check_only(job_with(R"("step": 0.1)"), "has a column of the time beside \"step\"");
    check_only(job_with(R"("every": 1)", R"("phi": "theta")"), "or their \"step\" beside \"file\"");
    check_only(section_job(R"("every": 2)"), "belongs to \"kind\": \"samples\"");
    check_only(section_job(R"("spacing": "any")"), "belongs to \"kind\": \"samples\"");
    check_only(section_job(R"("step": 0.1)"), "belongs to samples in a table");
    check_only(section_job(R"("window": [0, 1])"), "needs the times of the record");
    check_only(
        R"({ "model": { "name": "free_pendulum" }, "data": { "simulate": { "samples": { "step": 0.1, "count": 9 } },
      "window": [0, 1] } })",
        "belongs to");
}

TEST_CASE("an estimate uses the part of the record that the job names", "[apps][job][run]") {
    const tests::TemporaryFolder folder;
    write_record(folder.path());
    const json base = json::parse(R"({ "file": "run.csv", "kind": "samples", "observe": ["phi"] })");
    const auto points = [&](const std::string& name, const json& more) {
        json data = base;
        data.update(more);
        const json result = tests::read_json(run(folder.path(), name, swing(data)) / "result.json");
        CHECK_THAT(result["parameters"]["c2"]["value"].get<double>(), WithinAbs(0.05, 0.01));
        return result["data"]["points"].get<int>();
    };
    CHECK(points("whole", json::object()) == 401);
    CHECK(points("window", {{"window", {1.0, 3.0}}}) == 201);
    CHECK(points("rows", {{"rows", {1, 200}}}) == 200);
    CHECK(points("thinned", {{"every", 2}}) == 201);
    CHECK(points("stepped", {{"step", 0.01}, {"columns", {{"phi", "phi"}}}}) == 401);
    // Each at its own time: the last half of the record lacks every other row.
    std::istringstream lines(read_whole_file(folder.path() / "run.csv"));
    std::string text;
    int row = 0;
    for (std::string line; std::getline(lines, line); ++row)
        if (row < 200 || row % 2 == 0) text += line + "\n";
    tests::write_text(folder.path() / "run.csv", text);
    json data = base;
    const Path job = tests::write_job(folder.path() / "jitter.json", swing(data));
    CHECK(orbid_with({"run", job, "--quiet"}).code == 3);
    CHECK(points("own_times", {{"spacing", "any"}}) > 290);
}

TEST_CASE("several files by a pattern are segments of one record", "[apps][job][run]") {
    const tests::TemporaryFolder folder;
    write_record(folder.path());
    std::filesystem::create_directory(folder.path() / "runs");
    for (const char* name : {"b", "a", "c10"})
        std::filesystem::copy_file(folder.path() / "run.csv", folder.path() / "runs" / (std::string(name) + ".csv"));
    const json data = json::parse(R"({ "files": "runs/*.csv", "kind": "samples", "observe": ["phi"],
      "columns": { "time": "t", "phi": "phi" }, "window": [0, 1], "segments": { "fit": ["a", "b"], "predict": ["c10"] } })");
    const Path out = run(folder.path(), "joined", swing(data));
    const json result = tests::read_json(out / "result.json");
    CHECK(result["data"]["points"] == 303);
    CHECK(result["data"]["segments"] == 3);
    REQUIRE(result["prediction"].size() == 3);
    CHECK(result["prediction"][2]["segment"] == "c10");
    // job.json repeats the run, until a file is not the same any more.
    const json complete = tests::read_json(out / "job.json");
    const json& entry = complete["data"].is_array() ? complete["data"][0] : complete["data"];
    CHECK(entry["files"] == "../runs/*.csv");
    CHECK(orbid_with({"check", out / "job.json"}).code == 0);
    tests::write_text(folder.path() / "runs" / "d.csv", "t,phi\n0,1\n0.01,1\n");
    const auto changed = orbid_with({"check", out / "job.json"});
    CHECK(changed.code == 3);
    CHECK_THAT(changed.error, tests::ContainsSubstring("runs/*.csv: is not the file the job was made for"));
    // Without a match nothing can be read.
    json none = swing(data);
    none["data"]["files"] = "runs/*.txt";
    const auto missing = orbid_with({"run", tests::write_job(folder.path() / "none.json", none), "--quiet"});
    CHECK(missing.code == 3);
    CHECK_THAT(missing.error, tests::ContainsSubstring("/data/files: no file matches"));
}

TEST_CASE("cycles of another part of the record are searched anew", "[apps][job][run]") {
    const tests::TemporaryFolder folder;
    const json simulated = json::parse(R"({ "model": { "name": "henon" },
      "data": { "simulate": { "sections": 4000, "initial": [[0.1, 0.1]] } }, "output": { "series": "csv" } })");
    std::filesystem::copy_file(run(folder.path(), "simulated", simulated) / "series.csv", folder.path() / "run.csv");
    const auto cycles = [&](const json& part) {
        json job = json::parse(R"({ "model": { "name": "henon" }, "orbits": { "periods": [1, 2] },
          "data": { "file": "run.csv", "kind": "section", "columns": { "x": "x", "y": "y" } } })");
        job["data"].update(part);
        const auto outcome = orbid_with(
            {"run", tests::write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--force"});
        CAPTURE(outcome.error);
        REQUIRE(outcome.code == 0);
        return tests::read_json(folder.path() / "out" / "cycles.json")["cycles"][0]["recurrences"].get<int>();
    };
    const int all = cycles(json::object());
    CHECK(cycles({{"rows", {1, 2000}}}) < all);
    CHECK(cycles(json::object()) == all);
}

TEST_CASE("a prediction reads all of a record, and as many samples as the fit", "[apps][job][predict]") {
    const tests::TemporaryFolder folder;
    write_record(folder.path());
    const json data =
        json::parse(R"({ "file": "run.csv", "kind": "samples", "observe": ["phi"], "window": [0, 2], "every": 2 })");
    const Path fitted = run(folder.path(), "half", swing(data));
    const auto outcome = orbid_with({"predict", fitted, folder.path() / "run.csv", "--out", folder.path() / "all"});
    CAPTURE(outcome.error);
    REQUIRE(outcome.code == 0);
    const json made = tests::read_json(folder.path() / "all" / "job.json");
    const json& entry = made["data"].is_array() ? made["data"][0] : made["data"];
    CHECK_FALSE(entry.contains("window"));
    CHECK(entry["every"] == 2);
    const json prediction = tests::read_json(folder.path() / "all" / "prediction.json");
    CHECK(prediction["segments"][0]["readings"] == 201);
}

}  // namespace job_record_part_test
