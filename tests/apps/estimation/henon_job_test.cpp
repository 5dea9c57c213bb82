// The example of a map: its cycles against the list of all of them (tests/reference/henon_cycles.json), its parameters
// from them.

#include <cmath>
#include <limits>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace henon_job_test {

using namespace orbid::tests;

TEST_CASE("the cycles of the Henon map are found and give its parameters", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", orbid::tests::source_folder() + "/configs/henon.json", "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json reference = read_json(orbid::tests::source_folder() + "/tests/reference/henon_cycles.json");
    const json found = read_json(out / "cycles.json");
    for (const int period : {1, 2, 4, 6, 7}) {
        CAPTURE(period);
        // One of the two fixed points lies off the attractor.
        const std::size_t expected =
            reference["prime_cycle_count"][std::to_string(period)].get<std::size_t>() - (period == 1 ? 1 : 0);
        std::size_t count = 0;
        for (const json& cycle : found["cycles"]) {
            if (cycle["period"] != period) continue;
            ++count;
            // The nearest known cycle, by the first point.
            const double x = cycle["points"][0][0];
            double distance = std::numeric_limits<double>::infinity();
            double multiplier = 0.0;
            for (const json& known : reference["cycles"]) {
                if (known["period"] != period) continue;
                for (const json& point : known["x_along_orbit"]) {
                    if (std::abs(point.get<double>() - x) >= distance) continue;
                    distance = std::abs(point.get<double>() - x);
                    multiplier = std::stod(known["unstable_multiplier"].get<std::string>());
                }
            }
            // Local quadratic fits of a quadratic map: nothing is left out but rounding.
            CHECK(distance < 1e-9);
            CHECK(std::abs(cycle["multipliers"][0][0].get<double>() / multiplier - 1.0) < 1e-6);
        }
        CHECK(count == expected);
    }
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    CHECK(std::abs(result["parameters"]["a"]["value"].get<double>() - 1.4) < 1e-9);
    CHECK(std::abs(result["parameters"]["b"]["value"].get<double>() - 0.3) < 1e-9);
    CHECK(result["orbits"]["missing"].empty());
    // The fixed point of a map is no state of rest: all nine take part.
    CHECK(result["residuals"][0]["used"] == 9);
}

TEST_CASE("periodic orbits of a map are computed from starts in a job", "[apps][run]") {
    const TemporaryFolder folder;
    const json job = json::parse(R"({ "model": { "name": "henon" },
      "periodic": { "orbits": [ { "period": 1, "points": [[0.6, 0.2]] },
                                { "period": 2, "points": [[0.97, -0.14], [-0.47, 0.29]] } ] } })");
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"periodic", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json orbits = read_json(out / "orbits.json");
    CHECK_THAT(orbits["cycles"][0]["points"][0][0].get<double>(), WithinAbs(0.6313544770895047, 1e-14));
    CHECK_THAT(orbits["cycles"][0]["multipliers"][0][0].get<double>(), WithinAbs(-1.92373885815340712, 1e-12));
    CHECK_THAT(orbits["cycles"][1]["points"][0][0].get<double>(), WithinAbs(0.9758000511750563, 1e-14));
    CHECK_THAT(orbits["cycles"][1]["multipliers"][0][0].get<double>(), WithinAbs(-3.01010066774027049, 1e-12));
    CHECK(orbits["section"].empty());
    CHECK(orbits["cycles"][0]["time"].is_null());
}

}  // namespace henon_job_test
