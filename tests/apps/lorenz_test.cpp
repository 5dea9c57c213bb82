// The example of an autonomous flow: the parameters of the Lorenz equations from noisy samples.

#include <cmath>

#include "tests/apps/program.hpp"
#include "tests/catch.hpp"

using namespace orbid::tests;

TEST_CASE("the parameters of the Lorenz equations are found from samples", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", ORBID_SOURCE_DIR "/configs/lorenz.json", "--out", out});
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
