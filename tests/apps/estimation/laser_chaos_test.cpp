// A chaotic laser of which one intensity is read: nobody gives a start of its states.

#include <cmath>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace laser_chaos_test {

using namespace orbid::tests;

TEST_CASE("the example of a chaotic laser", "[apps][run][series]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", source_folder() + "/configs/laser_chaos.json", "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    REQUIRE(result["status"] == "converged");
    for (const auto& [name, parameter] : result["parameters"].items()) {
        CAPTURE(name, parameter.dump());
        const double error = std::abs(parameter["value"].get<double>() - parameter["reference"].get<double>());
        CHECK(error < 3.0 * parameter["sd"].get<double>());
        // The search ends at the errors of the readings, not at some course that resembles them.
        CHECK(error < 5e-3 * parameter["reference"].get<double>());
    }
    CHECK(std::abs(result["errors"]["series.x"]["sd"].get<double>() - 0.5) < 0.03);
    CHECK_THAT(orbid::apps::read_whole_file(out / "log.txt"), ContainsSubstring("explains the readings"));
}

}  // namespace laser_chaos_test
