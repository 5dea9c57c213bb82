// Records that are read piece by piece: what is read, written, refused, and what a run makes of them.

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_stream_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::json;
using tests::orbid_with;
using tests::Path;

namespace {

/// A table of sections of a forced model; `part` stands in "data", `rest` after "orbits".
std::string stream_job(const std::string& part, const std::string& rest = "",
                       const std::string& orbits = "\"periods\": [1]") {
    return R"({ "model": { "name": "duffing" }, "orbits": { )" + orbits + R"( },
  "data": { "file": "../tests/apps/jobs/data/samples.csv", "kind": "section",
            "columns": { "x": "theta", "x_dot": "sd" }, )" +
           part + " }" + (rest.empty() ? "" : ",\n" + rest) + " }";
}

FileJob file_with(const std::string& part) {
    return tests::file_of(stream_job(part));
}

void refused(const std::string& job, const std::string& message) {
    check_only(job, message);
}

/// Iterates of the Henon map, two trajectories, in part`number`.csv or .h5.
void write_record(const Path& folder, const std::string& format, int number) {
    json job = json::parse(R"({ "model": { "name": "henon" },
      "data": { "simulate": { "sections": 120000, "trajectories": 2, "transient": 100 } } })");
    job["data"]["simulate"]["initial"] = {{0.1, 0.1 + 0.01 * number}, {0.2, 0.1 + 0.01 * number}};
    job["output"]["series"] = format;
    const std::string name = fmt::format("part{}", number);
    const auto outcome = orbid_with({"simulate", tests::write_job(folder / (name + ".json"), job), "--quiet"});
    CAPTURE(outcome.error);
    REQUIRE(outcome.code == 0);
    std::filesystem::rename(folder / name / ("series." + format), folder / (name + "." + format));
    std::filesystem::remove_all(folder / name);
}

json cycles_of(const Path& folder, const std::string& name, const json& data) {
    json job = json::parse(R"({ "model": { "name": "henon" },
      "orbits": { "periods": [1, 2, 4], "method": "local_maps" } })");
    job["data"] = data;
    const auto outcome = orbid_with({"run", tests::write_job(folder / (name + ".json"), job), "--quiet"});
    CAPTURE(outcome.error);
    REQUIRE(outcome.code == 0);
    return tests::read_json(folder / name / "cycles.json");
}

}  // namespace

TEST_CASE("streams are read and written", "[apps][job]") {
    CHECK(file_with(R"("missing": "nan")").stream_memory == 0.0);
    CHECK(file_with(R"("stream": false)").stream_memory == 0.0);
    CHECK(file_with(R"("stream": true)").stream_memory == 1000.0);
    CHECK(file_with(R"("stream": {})").stream_memory == 1000.0);
    CHECK(file_with(R"("stream": { "memory": 64 })").stream_memory == 64.0);
}

TEST_CASE("what a stream cannot do is refused with place and rule", "[apps][job]") {
    refused(stream_job(R"("stream": { "memory": 1 })"), "/data/stream/memory: must be >= 16");
    refused(stream_job(R"("stream": 5)"), "/data/stream: must be true, false or");
    refused(stream_job(R"("stream": true, "rows": [1, 5])"),
            "/data/rows: does not go with \"stream\": all of a stream is read, for cycles only");
    refused(stream_job(R"("stream": true)", "", R"("periods": [1], "invariants": true)"),
            "/orbits/invariants: are of records that are read as a whole, but \"run1\" is a stream");
    const std::string estimate = R"("estimate": { "parameters": { "beta": { "start": 0.3 } }, )";
    refused(stream_job(R"("stream": true)", estimate + R"("residuals": [ { "type": "series" } ] })"),
            "/estimate/residuals/0: needs an entry of \"data\", no stream");
    refused(stream_job(R"("stream": true)",
                       estimate + R"("residuals": [ { "type": "cycles" } ], "strategy": ["cycles", "harvest"] })"),
            "/estimate/strategy/1: needs \"orbits\" that are searched for in a series, which is no stream");
    refused(stream_job(R"("stream": true)",
                       estimate + R"("residuals": [ { "type": "cycles" } ], "strategy": ["prediction", "cycles"] })"),
            "/estimate/strategy/0: needs a series");
    // Cycles alone can be estimated from.
    const auto reading =
        read_job(stream_job(R"("stream": true)", estimate + R"("strategy": "auto" })"), tests::job_folder / "job.json");
    REQUIRE(reading.job);
    REQUIRE(reading.job->estimate->strategy.size() == 1);
    CHECK(reading.job->estimate->strategy[0].name() == "cycles");
    CHECK_FALSE(reading.job->estimate->series);
}

TEST_CASE("the cycles of a stream are those of the record", "[apps][run]") {
    const tests::TemporaryFolder folder;
    for (const std::string format : {"csv", "h5"}) {
        CAPTURE(format);
        for (int i = 0; i < 3; ++i)
            write_record(folder.path(), format, i);
        json data = {{"file", "part0." + format}, {"kind", "section"}};
        if (format == "csv") data["columns"] = {{"segment", "segment"}, {"x", "x"}, {"y", "y"}};
        const json whole = cycles_of(folder.path(), format + "_whole", data);
        data["stream"] = true;
        const json fits = cycles_of(folder.path(), format + "_fits", data);
        CHECK(fits["cycles"] == whole["cycles"]);
        // 16 MB hold 250 000 points of two coordinates.
        data.erase("file");
        data["stream"] = {{"memory", 16}};
        data["files"] = "part*." + format;
        const json parts = cycles_of(folder.path(), format + "_parts", data);
        REQUIRE(parts["cycles"].size() == whole["cycles"].size());
        CHECK_THAT(parts["remarks"].dump(), ContainsSubstring("Of 360000 points 250000 fit into memory"));
        for (std::size_t i = 0; i < parts["cycles"].size(); ++i) {
            CHECK(parts["cycles"][i]["period"] == whole["cycles"][i]["period"]);
            // The map is a polynomial: every fit of it is exact.
            for (std::size_t k = 0; k < parts["cycles"][i]["multipliers"].size(); ++k)
                CHECK(std::abs(parts["cycles"][i]["ln_multiplier"][k].get<double>() -
                               whole["cycles"][i]["ln_multiplier"][k].get<double>()) < 1e-6);
        }
    }
}

}  // namespace job_stream_test
