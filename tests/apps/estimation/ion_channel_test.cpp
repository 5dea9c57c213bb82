// A potassium channel under a known voltage: the published constants, their error, and intervals that say how little
// the residuals of this model allow.

#include <cmath>
#include <sstream>
#include <string>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace ion_channel_test {

using namespace orbid;
using namespace orbid::tests;

TEST_CASE("Ion channel: published constants from one protocol, with intervals for errors that last", "[apps][run]") {
    const TemporaryFolder folder;
    const std::string data = source_folder() + "/configs/data/ion_channel/";
    json job = json::parse(apps::read_whole_file(source_folder() + "/configs/ion_channel.json"), nullptr, true, true);
    job["data"]["file"] = data + "current.csv";
    job["data"]["inputs"]["file"] = data + "voltage.csv";
    job["data"]["every"] = 10;  // the errors last for a second: nothing is lost
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(folder.path() / "out" / "result.json");
    REQUIRE(result["status"] == "converged");
    // The authors' means leave 0.0317 nA on all readings.
    CHECK(result["errors"]["series.a"]["rms"].get<double>() < 0.0325);

    std::istringstream published(apps::read_whole_file(data + "published.csv"));
    std::string name, mean, sd;
    std::getline(published, name);
    int compared = 0;
    while (std::getline(published, name, ',') && std::getline(published, mean, ',') && std::getline(published, sd)) {
        const json& found = result["parameters"][name];
        CAPTURE(name, found.dump());
        CHECK(found["interval95"][0].get<double>() < std::stod(mean));
        CHECK(found["interval95"][1].get<double>() > std::stod(mean));
        // Errors were taken as independent: residuals of one second repeat each other.
        CHECK(found["sd"].get<double>() > 30.0 * std::stod(sd));
        ++compared;
    }
    CHECK(compared == 9);
}

}  // namespace ion_channel_test
