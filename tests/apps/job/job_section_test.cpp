// Sections of autonomous flows and maps in a job: what is read, written, run and refused.

#include <cmath>
#include <sstream>

#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/check/job_summary.hpp"
#include "orbits/records/series_file.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_section_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::WithinAbs;

namespace {

std::string lorenz_job(const std::string& section, const std::string& output = "csv") {
    return R"({ "model": { "name": "lorenz" }, "seed": 2,
  )" + (section.empty() ? "" : "\"section\": " + section + ",") +
           R"(
  "data": { "name": "falls", "simulate": { "sections": 60, "trajectories": 2, "transient": 10,
    "initial": [[1, 1, 20], [-3, -4, 25]] } },
  "output": { "series": ")" +
           output + "\" } }";
}

}  // namespace

TEST_CASE("a section of an autonomous flow is read and written", "[apps][job]") {
    const auto plane = [](const std::string& section) {
        const auto reading = read_job(lorenz_job(section), job_folder / "job.json");
        REQUIRE(reading.job);
        const std::string complete = job_text(*reading.job, job_folder);
        const auto again = read_job(complete, job_folder / "job.json");
        REQUIRE(again.job);
        CHECK(job_text(*again.job, job_folder) == complete);
        return *again.job->section_plane;
    };
    const auto falling = plane(R"({ "coordinate": "z", "value": 27, "direction": -1 })");
    CHECK(falling.coordinate == 2);
    CHECK(falling.value == 27.0);
    CHECK(falling.direction == -1);
    CHECK(plane(R"({ "coordinate": "x", "value": -1.5 })").direction == 1);
    const auto job =
        read_job(lorenz_job(R"({ "coordinate": "z", "value": 27, "direction": -1 })"), job_folder / "job.json");
    CHECK_THAT(job_summary(*job.job), ContainsSubstring("  section    z = 27, falling\n"));
}

TEST_CASE("sections that cannot be are refused with place and rule", "[apps][job]") {
    const std::string at = "job.json:2: /section";
    const auto refused = [&](const std::string& section, const std::string& rule) {
        check_only(lorenz_job(section), at + rule);
    };
    refused(R"({ "phase": 0 })", "/phase: the model lorenz is not forced: it has no phase");
    refused(R"({ "coordinate": "z", "value": 27, "phase": 0 })", "/phase: the model lorenz is not forced");
    refused(R"({ "coordinate": "z" })", ": \"value\" is missing");
    refused(R"({ "value": 27 })", "/value: belongs to \"coordinate\"");
    refused(R"({ "coordinate": "w", "value": 27 })", "/coordinate: the model lorenz has no coordinate \"w\"");
    refused(R"({ "coordinate": "z", "value": 27, "direction": 0 })", "/direction: must be one of 1, -1");
    refused(R"({ "coordinate": "z", "value": 27, "normal": [0, 0, 1] })", "/normal: unknown key");
    check_only(lorenz_job(""), "/data/simulate/sections: the model lorenz is not forced: name the section");
    check_only(R"({ "model": { "name": "free_pendulum" }, "section": { "coordinate": "phi", "value": 0 },
      "data": { "simulate": { "sections": 10 } } })",
               "/section/coordinate: a section at an angle: not in this version");
    check_only(R"({ "model": { "name": "duffing" }, "section": { "coordinate": "x", "value": 0 },
      "data": { "simulate": { "sections": 10 } } })",
               "/section/coordinate: a section of a forced model by a coordinate: not in this version");
    check_only(R"({ "model": { "name": "henon" }, "section": { "coordinate": "x", "value": 0 },
      "data": { "simulate": { "sections": 10 } } })",
               "/section: the model henon is a map: its iterates are the section");
    check_only(R"({ "model": { "name": "henon" }, "section": { "phase": 0 },
      "data": { "simulate": { "sections": 10 } } })",
               "/section/phase: the model henon is not forced: it has no phase");
    check_only(R"({ "model": { "name": "henon" }, "data": { "simulate": { "samples": { "step": 1, "count": 9 } } } })",
               "/data/simulate/samples: the model henon is a map: it has no samples in time");
}

TEST_CASE("what cycles of autonomous flows cannot be is refused", "[apps][job]") {
    const auto with = [](const std::string& block) {
        std::string text = lorenz_job(R"({ "coordinate": "z", "value": 27 })");
        return text.replace(text.find("\"output\""), 0, block + ", ");
    };
    const auto of_cycles = [&](const std::string& keys) {
        return with(R"("orbits": { "periods": [2] },
                       "estimate": { "parameters": {}, "residuals": [ { "type": "cycles")" +
                    keys + " } ] }");
    };
    const std::string at = "/estimate/residuals/0";
    CHECK(tests::problems(of_cycles("")).empty());
    CHECK(tests::problems(of_cycles(R"(, "positions": false, "errors": { "time": { "sd": 2 } })")).empty());
    check_only(of_cycles(R"(, "positions": false, "times": false)"), at + "/positions: must be true");
    check_only(of_cycles(R"(, "errors": { "z": { "sd": 0.1 } })"),
               at + "/errors/z: \"z\" has the value of the section");
    check_only(of_cycles(R"(, "times": false, "errors": { "time": { "sd": 2 } })"),
               at + "/errors/time: needs \"times\": true");
    check_only(with(R"("orbits": { "partition": { "coordinate": "z", "boundaries": [0], "symbols": "AB" } })"),
               "/orbits/partition/coordinate: has the same value at all points of the section");
    check_only(with(R"("orbits": { "partition": { "coordinate": "x", "boundaries": [0, 0], "symbols": "ABC" } })"),
               "/orbits/partition/boundaries/1: must be above the boundary before it, 0");
    check_only(with(R"("orbits": { "partition": { "coordinate": "x", "boundaries": [0], "symbols": "A" } })"),
               "/orbits/partition/symbols: must have one character per part: 2, not 1");
    check_only(with(R"("orbits": { "reading_error": { "x": 0.1 } })"), "/orbits/reading_error: \"y\" is missing");
    check_only(with(R"("orbits": { "reading_error": { "x": 0.1, "y": 0 } })"), "/orbits/reading_error/y: must be");
    check_only(with(R"("periodic": { "orbits": [ { "period": 1, "points": [[1, 1, 20]] } ] })"),
               "/periodic/orbits/0/points/0: must lie on the section, where z is 27");
    check_only(with(R"("estimate": { "parameters": {},
                       "residuals": [ { "type": "series", "data": ["falls"], "interval": "segment" } ] })"),
               "/interval: holds for samples: a section series is followed from section to section");
}

TEST_CASE("crossings of a section are simulated, stored with their times, and found again", "[apps][run]") {
    for (const std::string format : {"csv", "h5"}) {
        CAPTURE(format);
        const tests::TemporaryFolder work;
        const auto out = work.path() / "out";
        const auto job = tests::write_text(
            work.path() / "job.json", lorenz_job(R"({ "coordinate": "z", "value": 27, "direction": -1 })", format));
        const auto run = tests::orbid_with({"run", job, "--out", out});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        const auto file = out / ("series." + format);
        orbits::TableLayout layout;
        layout.segment = "segment";
        layout.time = "t";
        for (const char* name : {"x", "y", "z"})
            layout.coordinates.push_back({{name, "1", false}, name, "1", 1.0, 0.0, {}});
        const auto series = format == "csv" ? orbits::read_csv(file, layout) : orbits::read_hdf5(file);
        REQUIRE(series.timed());
        CHECK(series.sampling == orbits::Series::Sampling::section);
        CHECK(series.size() == 60);
        for (const auto& segment : series.segments) {
            for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
                const double x = segment.values(0, k), y = segment.values(1, k), z = segment.values(2, k);
                CHECK_THAT(z, WithinAbs(27.0, 1e-10));
                CHECK(x * y - 8.0 / 3.0 * z < 0.0);  // falling
                if (k > 0) CHECK(segment.times[k] > segment.times[k - 1]);
            }
        }
        // The stored file is taken again, and the complete job makes the same one.
        CHECK(tests::orbid_with({"run", job, "--out", out}).code == 0);
        CHECK(tests::read_json(out / "timing.json")["stages"][0]["reused"] == true);
        CHECK(tests::orbid_with({"run", out / "job.json", "--out", work.path() / "again"}).code == 0);
        CHECK((read_whole_file(file) == read_whole_file(work.path() / "again" / file.filename())));
    }
}

}  // namespace job_section_test
