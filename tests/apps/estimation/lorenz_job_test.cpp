// The examples of an autonomous flow: the parameters of the Lorenz equations from noisy samples, and its cycles.

#include <cmath>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace lorenz_job_test {

using namespace orbid::tests;

TEST_CASE("the parameters of the Lorenz equations are found from samples", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", orbid::tests::source_folder() + "/configs/lorenz.json", "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    for (const auto& [name, truth] :
         std::map<std::string, double>{{"sigma", 10.0}, {"rho", 28.0}, {"beta", 8.0 / 3.0}}) {
        CAPTURE(name);
        const json& parameter = result["parameters"][name];
        CHECK(std::abs(parameter["value"].get<double>() - truth) < 4.0 * parameter["sd"].get<double>());
        CHECK(parameter["sd"].get<double>() < 0.01 * truth);
    }
    // 505 readings of each coordinate: the sd of their errors is known to 1 / sqrt(1010) = 3 %; four of that.
    for (const char* name : {"series.x", "series.y", "series.z"})
        CHECK_THAT(result["errors"][name]["sd"].get<double>(), WithinRel(0.2, 0.13));
    // The segment that took no part is predicted as well as noise allows, its own three initial values fitted.
    REQUIRE(result["prediction"].size() == 6);
    CHECK(result["prediction"][5]["fitted"] == false);
    CHECK_THAT(result["prediction"][5]["normalised_rms"].get<double>(), WithinRel(1.0, 0.2));
}

TEST_CASE("the cycles of the Lorenz equations are found and named in crossings of a plane", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run =
        orbid_with({"run", orbid::tests::source_folder() + "/configs/lorenz_cycles.json", "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    CHECK(run.error.find("no cycle of period 1 was found") != std::string::npos);
    const json found = read_json(out / "cycles.json");
    CHECK(found["section"] == json({{"coordinate", "z"}, {"value", 27.0}, {"direction", 1}}));
    CHECK(found["coordinates"] == json({"x", "y"}));
    // Every sequence of up to 5 wings but A and B alone is that of a cycle: 1, 2, 3 and 6 prime ones. Ten were computed
    // with 25 digits by an independent program.
    CHECK(found["cycles"].size() == 12);
    const json reference = read_json(orbid::tests::source_folder() + "/tests/reference/lorenz_orbits.json");
    int matched = 0;
    for (const json& orbit : reference["cycles"]) {
        const std::string name = orbit["code"];
        CAPTURE(name);
        for (const json& cycle : found["cycles"]) {
            const std::string code = cycle["code"];
            if (code.size() != name.size() || (name + name).find(code) == std::string::npos) continue;
            ++matched;
            // Some point of the cycle is the reference's; measured 1e-6, and 2e-5 of a multiplier.
            double nearest = 1.0;
            for (const json& point : cycle["points"])
                nearest =
                    std::min(nearest, std::hypot(point[0].get<double>() - std::stod(orbit["x"].get<std::string>()),
                                                 point[1].get<double>() - std::stod(orbit["y"].get<std::string>())));
            CHECK(nearest < 1e-5);
            CHECK_THAT(cycle["multipliers"][0][0].get<double>(),
                       WithinRel(std::stod(orbit["unstable_multiplier"].get<std::string>()), 2e-4));
        }
    }
    CHECK(matched == 10);
}

TEST_CASE("a section is cut from samples and searched, its invariants told", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    std::string text = R"({
      "model": { "name": "lorenz" }, "seed": 1,
      "section": { "coordinate": "z", "value": 27, "direction": 1 },
      "data": { "simulate": { "samples": { "step": 0.01, "count": 200001 }, "initial": [[1, 1, 20]] } },
      "orbits": { "periods": [2, 3], "partition": { "coordinate": "x", "boundaries": [0], "symbols": "AB" },
                  "invariants": { "complete_to": 3, "continuous": false } } })";
    const Path job = write_text(folder.path() / "job.json", text);
    const Outcome run = orbid_with({"run", job, "--out", out});
    CAPTURE(run.error);
    // The list must hold all periods up to the one it is complete to.
    CHECK(run.code == 2);
    CHECK(run.error.find("/orbits/invariants/complete_to: period 1 is not searched for") != std::string::npos);
    text.replace(text.find("[2, 3]"), 6, "[1, 2, 3]");
    const Path good = write_text(folder.path() / "good.json", text);
    const Outcome second = orbid_with({"run", good, "--out", out});
    CAPTURE(second.error);
    REQUIRE(second.code == 0);
    CHECK(second.error.find("points of the section from 200001 samples") != std::string::npos);
    const json found = read_json(out / "cycles.json");
    REQUIRE(found["cycles"].size() == 3);
    for (const json& cycle : found["cycles"]) {
        // tests/reference/lorenz_orbits.json: AB 1.5586522, AAB and ABB 2.3059073
        const double exact = cycle["period"] == 2 ? 1.558652210716175 : 2.305907263939848;
        CHECK_THAT(cycle["time"].get<double>(), WithinRel(exact, 1e-5));
    }
    const json invariants = read_json(out / "invariants.json");
    CHECK(invariants["format"] == "orbid-invariants/1");
    // 0.9056 per second; 2000 s give it to 1.3 %, three sds
    CHECK_THAT(invariants["lyapunov"]["exponents"][0].get<double>(), WithinRel(0.9056, 0.04));
    CHECK(invariants["cycle_expansion"]["by_period"].size() == 3);
    CHECK(invariants["correlation"]["dimension"].get<double>() < 1.2);
    CHECK(second.out.find("Lyapunov exponents [1/s]") != std::string::npos);
}

}  // namespace lorenz_job_test
