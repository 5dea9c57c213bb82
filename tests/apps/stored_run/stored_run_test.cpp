#include "apps/stored_run/stored_run.hpp"

#include <cmath>

#include "orbits/records/data_error.hpp"
#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace stored_run_test {

using namespace orbid::apps;
using namespace orbid::tests;
using orbid::orbits::DataError;

namespace {

/// What reading a folder is refused with.
template <class Error>
std::string refusal(const Path& folder) {
    try {
        (void)read_stored_run(folder);
    } catch (const Error& error) {
        return error.what();
    }
    return "not refused";
}

}  // namespace

TEST_CASE("a stored run is what its folder holds", "[apps][stored]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    const StoredRun run = read_stored_run(folder.path());
    CHECK(run.title() == "made <by> hand");
    REQUIRE(run.experiments().size() == 1);
    CHECK(run.experiments()[0]->at("name") == "run1");
    REQUIRE(run.result.has_value());
    // The order of the file, not of the alphabet.
    CHECK(run.result->at("parameters").begin().key() == "b");
    CHECK(run.cycles.has_value());
    CHECK_FALSE(run.orbits.has_value());
    CHECK_FALSE(run.branch.has_value());
    CHECK(run.orbits_of_estimate() == nullptr);
    CHECK(stored_model(run).system->name() == "henon");
    CHECK_FALSE(stored_draws(run).has_value());
    // Simulated, and not stored.
    CHECK_FALSE(stored_series(run, 0).has_value());
    CHECK_THROWS_AS(stored_series(run, 1), std::invalid_argument);
}

TEST_CASE("values of another kind in result.json are refused with their place", "[apps][stored]") {
    struct Case {
        std::string pointer, value, message;
    };
    const std::vector<Case> cases{
        {"/parameters/a/value", "\"1.4\"", "/parameters/a/value"},
        {"/parameters/a/interval95", "[1.38]", "/parameters/a/interval95"},
        {"/parameters/a", "[]", "/parameters/a"},
        {"/parameters/b/unit", "1", "/parameters/b/unit"},
        {"/errors/series.x/count", "-4", "/errors/series.x/count"},
        {"/correlation/matrix", "[[1, 0], [0]]", "/correlation/matrix/1"},
        {"/correlation/names", "[\"b\"]", "/correlation/matrix"},
        {"/history", "{}", "/history"},
        {"/status", "null", "/status"},
    };
    for (const Case& one : cases) {
        CAPTURE(one.pointer, one.value);
        const TemporaryFolder folder;
        write_stored_run(folder.path());
        json result = read_json(folder.path() / "result.json");
        result[json::json_pointer(one.pointer)] = json::parse(one.value);
        write_text(folder.path() / "result.json", result.dump());
        CHECK_THAT(refusal<DataError>(folder.path()),
                   ContainsSubstring("result.json") && ContainsSubstring(one.message));
    }
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    json result = read_json(folder.path() / "result.json");
    result.erase("parameters");
    write_text(folder.path() / "result.json", result.dump());
    CHECK_THAT(refusal<DataError>(folder.path()), ContainsSubstring("\"parameters\" is missing"));
}

TEST_CASE("residuals and draws of a stored run are read to the bit", "[apps][stored]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    const StoredRun run = read_stored_run(folder.path());
    const auto rows = stored_residuals(run);
    REQUIRE(rows.size() == 4);
    CHECK(rows[0].block == "a, b");
    CHECK(rows[0].observed == 1.5);
    CHECK(rows[1].predicted == 2.5);
    CHECK(std::isnan(rows[2].observed));
    write_text(folder.path() / "posterior.csv", "chain,draw,a,b,minus_log_density\n1,1,1.25,0.5,3\n2,1,1.5,0.25,4\n");
    const auto draws = stored_draws(run);
    REQUIRE(draws.has_value());
    CHECK(draws->names == std::vector<std::string>{"a", "b"});
    CHECK(draws->chain == std::vector<int>{1, 2});
    CHECK(draws->columns == std::vector<std::vector<double>>{{1.25, 1.5}, {0.5, 0.25}});
    write_text(folder.path() / "residuals.csv",
               "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd\nrun1,0,x,0,one,1,1\n");
    try {
        (void)stored_residuals(run);
        FAIL("a cell that is no number was read");
    } catch (const DataError& error) {
        CHECK_THAT(error.what(), ContainsSubstring("residuals.csv:2") && ContainsSubstring("observed"));
    }
}

TEST_CASE("folders that are no stored run are refused with file and place", "[apps][stored]") {
    const TemporaryFolder folder;
    CHECK_THAT(refusal<StoredRunRefused>(folder.path() / "none"), ContainsSubstring("no such folder"));
    CHECK_THAT(refusal<StoredRunRefused>(folder.path()), ContainsSubstring("holds no job.json"));
    CHECK_THAT(refusal<StoredRunRefused>(write_text(folder.path() / "file", "x")), ContainsSubstring("is a file"));
    write_stored_run(folder.path());
    write_text(folder.path() / "result.json", "{\n  \"format\": \"orbid-result/1\",\n  \"status\": conv\n}");
    CHECK_THAT(refusal<DataError>(folder.path()), ContainsSubstring("result.json:3:13: is not JSON"));
    write_text(folder.path() / "result.json", "{ \"format\": \"orbid-result/9\" }");
    CHECK_THAT(refusal<DataError>(folder.path()),
               ContainsSubstring("/format: is \"orbid-result/9\", this version reads \"orbid-result/1\""));
    write_text(folder.path() / "result.json", "[1]");
    CHECK_THAT(refusal<DataError>(folder.path()), ContainsSubstring("must be an object { ... }, is array"));
    write_text(folder.path() / "result.json", "{}");
    CHECK_THAT(refusal<DataError>(folder.path()), ContainsSubstring("/format: is missing"));
}

TEST_CASE("a stored record is found in the folder or where it was read from", "[apps][stored]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    json job = json::parse(R"({ "model": { "name": "henon" }, "seed": 2,
        "data": { "name": "run1", "simulate": { "sections": 3000 } }, "output": { "series": "csv" } })");
    REQUIRE(orbid_with({"simulate", write_job(folder.path() / "job.json", job), "--out", out}).code == 0);
    const auto simulated = stored_series(read_stored_run(out), 0);
    REQUIRE(simulated.has_value());
    CHECK(simulated->size() == 3000);

    std::filesystem::copy_file(out / "series.csv", folder.path() / "record.csv");
    json measured = json::parse(R"({ "model": { "name": "henon" },
        "data": { "name": "run1", "file": "record.csv", "kind": "section",
                  "columns": { "segment": "segment", "x": "x", "y": { "column": "y", "unit": "1", "sign": -1 } } },
        "orbits": { "periods": [1] } })");
    REQUIRE(orbid_with({"orbits", write_job(folder.path() / "measured.json", measured)}).code <= 1);
    const StoredRun run = read_stored_run(folder.path() / "measured");
    const auto recorded = stored_series(run, 0);
    REQUIRE(recorded.has_value());
    CHECK(recorded->segments[0].values.row(0) == simulated->segments[0].values.row(0));
    CHECK(recorded->segments[0].values.row(1) == -simulated->segments[0].values.row(1));
    // Without the record the model is still known.
    std::filesystem::remove(folder.path() / "record.csv");
    CHECK_THROWS_AS(stored_series(run, 0), DataError);
    CHECK(stored_model(run).system->dimension() == 2);
}

}  // namespace stored_run_test
