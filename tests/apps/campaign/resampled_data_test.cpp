#include "apps/campaign/engine/resampled_data.hpp"

#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace orbid::resampled_data_test {
namespace {

using nlohmann::ordered_json;
using tests::TemporaryFolder;

/// Two coordinates of one segment; errors of x follow each other with correlation, those of y alternate; sds 0.5 and 2.
std::string residuals(int count) {
    std::string text = "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd\n";
    for (int i = 0; i < count; ++i)
        text += fmt::format("run,\"a, b\",x,{},{},{},0.5\n", 0.1 * i, 10.0 + 0.3 * std::sin(0.05 * i), 10.0);
    for (int i = 0; i < count; ++i)
        text += fmt::format("run,\"a, b\",y,{},{},{},2\n", 0.1 * i, -3.0 + (i % 2 == 0 ? 1.0 : -1.0), -3.0);
    return text;
}

TEST_CASE("Data drawn anew scatter about what was predicted, with the errors' sd and correlation", "[campaign]") {
    const TemporaryFolder folder;
    constexpr int count = 4000;
    tests::write_text(folder.path() / "residuals.csv", residuals(count));
    const apps::ResampledData data(folder.path());
    ordered_json job = {{"data",
                         {{{"name", "run"},
                           {"file", "measured.csv"},
                           {"kind", "samples"},
                           {"sha256", "00"},
                           {"columns", {{"time", "t"}, {"x", "x"}, {"y", "y"}}},
                           {"segments", {{"predict", {"c"}}}}}}}};
    const ordered_json before = job;
    data.put_into(job, 1, folder.path());
    const ordered_json& one = job["data"][0];
    CHECK_FALSE(one.contains("sha256"));
    CHECK_FALSE(one.contains("segments"));
    CHECK(one["columns"]["segment"] == "segment");

    std::istringstream table(apps::read_whole_file(one["file"].get<std::string>()));
    std::string line;
    REQUIRE(std::getline(table, line));
    CHECK(line == "segment,time,x,y");
    std::vector<double> x, y;
    while (std::getline(table, line)) {
        REQUIRE(line.starts_with("\"a, b\","));
        std::istringstream cells(line.substr(7));
        std::string time, first, second;
        std::getline(cells, time, ',');
        std::getline(cells, first, ',');
        std::getline(cells, second, ',');
        x.push_back(std::stod(first) - 10.0);
        y.push_back(std::stod(second) + 3.0);
    }
    REQUIRE(x.size() == count);
    const auto mean_product = [](const std::vector<double>& errors, std::size_t lag) {
        double sum = 0.0;
        for (std::size_t i = 0; i + lag < errors.size(); ++i)
            sum += errors[i] * errors[i + lag];
        return sum / static_cast<double>(errors.size() - lag);
    };
    CHECK_THAT(std::sqrt(mean_product(x, 0)), tests::WithinAbs(0.5, 0.05));
    CHECK_THAT(std::sqrt(mean_product(y, 0)), tests::WithinAbs(2.0, 1e-9));
    CHECK(mean_product(x, 1) / mean_product(x, 0) > 0.9);
    CHECK(mean_product(y, 1) / mean_product(y, 0) < -0.8);

    // Another seed, another record; the same seed, the same bytes.
    const auto bytes = [&](std::uint64_t seed) {
        ordered_json again = before;
        data.put_into(again, seed, folder.path());
        return apps::read_whole_file(again["data"][0]["file"].get<std::string>());
    };
    CHECK(bytes(1) == bytes(1));
    CHECK(bytes(1) != bytes(2));
}

TEST_CASE("A run without residuals of records cannot be drawn anew", "[campaign]") {
    const TemporaryFolder folder;
    CHECK_THROWS_WITH(apps::ResampledData(folder.path()), tests::ContainsSubstring("does not exist"));
    tests::write_text(folder.path() / "residuals.csv",
                      "experiment,segment_or_cycle,coordinate,time_or_phase,observed,"
                      "predicted,sd\nrun,0,x,0,1,1,\n");
    CHECK_THROWS_WITH(apps::ResampledData(folder.path()), tests::ContainsSubstring("no errors with a known sd"));
}

}  // namespace
}  // namespace orbid::resampled_data_test
