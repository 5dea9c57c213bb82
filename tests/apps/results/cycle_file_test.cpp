#include "apps/results/cycle_file.hpp"

#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/results/cycle_reader.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::cycle_file_test {
namespace {

using tests::ContainsSubstring;

const auto pendulum = models::make_system("parametric_pendulum");

apps::CycleReading parsed(const std::string& text) {
    return apps::parse_cycles(text, pendulum->name(), apps::series_coordinates(*pendulum));
}

apps::CycleFileHead head() {
    return {"parametric_pendulum",
            {{"phi", "rad", true}, {"phi_dot", "rad/s", false}},
            0.1,
            std::nullopt,
            2.0 / 3.0,
            apps::fingerprint({{"/seed", "1"}})};
}

/// Numbers with no short decimal form, so that a lost bit shows.
apps::CycleFile two_cycles() {
    apps::CycleFile file{head(), {}};
    for (int period = 1; period <= 2; ++period) {
        orbits::Cycle cycle;
        cycle.period = period;
        cycle.rotation = {period - 2};
        cycle.points = Eigen::MatrixXd::Constant(2, period, 1.0 / 3.0);
        cycle.points(0, 0) = -2.0 / 7.0;
        cycle.points(1, 0) = -0.0;
        cycle.covariance = Eigen::MatrixXd::Identity(2 * period, 2 * period) / 7e11;
        cycle.covariance(0, 1) = cycle.covariance(1, 0) = 1.0 / 9e12;
        cycle.multipliers = {{-5.0 / 3.0, 0.0}, {-0.1, 1e-3 / 3.0}};
        cycle.ln_multiplier = Eigen::Vector2d(std::log(5.0 / 3.0), -2.3);
        cycle.ln_multiplier_covariance = Eigen::Matrix2d::Identity() / 3.0;
        cycle.common = Eigen::MatrixXd::Constant(2 * period + 2, 3, 1.0 / 7e6);
        cycle.recurrences = 17;
        cycle.quality = {"few neighbours"};
        cycle.time = 2.0 / 3.0 * period;
        cycle.time_sd = 1e-5 / 3.0;
        if (period == 2) {
            cycle.time_covariance = Eigen::VectorXd::Constant(4, -1e-11 / 3.0);
            cycle.common.conservativeResize(7, Eigen::NoChange);  // the last row is that of the time
            cycle.common.row(6).setConstant(1.0 / 3e6);
        }
        cycle.code = std::string(static_cast<std::size_t>(period), 'A');
        file.search.cycles.push_back(cycle);
    }
    file.search.cycles[1].mirror = 0;
    file.search.missing = {3, 5};
    file.search.candidates = 12;
    file.search.rejected = 4;
    file.search.spline_map = true;
    file.search.reading_covariance = Eigen::Matrix2d::Identity() / 3.0;
    file.search.remarks = {"One segment is constant."};
    return file;
}

TEST_CASE("cycles.json has the layout of the contract", "[apps]") {
    const auto json = nlohmann::json::parse(apps::cycles_text(two_cycles()));
    CHECK(json["format"] == "orbid-cycles/1");
    CHECK(json["model"] == "parametric_pendulum");
    CHECK(json["coordinates"] == nlohmann::json({"phi", "phi_dot"}));
    CHECK(json["units"] == nlohmann::json({"rad", "rad/s"}));
    CHECK(json["section"]["phase"] == 0.1);
    REQUIRE(json["cycles"].size() == 2);
    const auto& cycle = json["cycles"][1];
    for (const char* key : {"period", "rotation", "points", "covariance", "multipliers", "ln_multiplier",
                            "ln_multiplier_covariance", "time", "recurrences", "mirror", "quality"}) {
        CAPTURE(key);
        CHECK(cycle.contains(key));
    }
    CHECK(cycle["points"].size() == 2);      // one row per point
    CHECK(cycle["points"][0].size() == 2);   // of all coordinates
    CHECK(cycle["covariance"].size() == 4);  // n p
    CHECK(cycle["multipliers"][1] == nlohmann::json({-0.1, 1e-3 / 3.0}));
    CHECK(cycle["time"] == 2.0 * (2.0 / 3.0));
    CHECK(cycle["mirror"] == 0);
    CHECK(json["cycles"][0]["mirror"].is_null());
}

TEST_CASE("cycles read back to the bit", "[apps]") {
    const auto file = two_cycles();
    const auto reading = parsed(apps::cycles_text(file));
    CAPTURE(reading.problems.empty() ? "" : reading.problems.front().rule);
    REQUIRE(reading.file);
    const auto& read = reading.file->search;
    REQUIRE(read.cycles.size() == 2);
    for (std::size_t i = 0; i < 2; ++i) {
        const auto& was = file.search.cycles[i];
        const auto& is = read.cycles[i];
        CHECK(is.period == was.period);
        CHECK(is.rotation == was.rotation);
        CHECK(is.points == was.points);
        CHECK(std::signbit(is.points(1, 0)));
        CHECK(is.covariance == was.covariance);
        CHECK(is.multipliers == was.multipliers);
        CHECK(is.ln_multiplier == was.ln_multiplier);
        CHECK(is.ln_multiplier_covariance == was.ln_multiplier_covariance);
        CHECK(is.common == was.common);
        CHECK(is.recurrences == was.recurrences);
        CHECK(is.mirror == was.mirror);
        CHECK(is.quality == was.quality);
        CHECK(is.time == was.time);
        CHECK(is.time_sd == was.time_sd);
        CHECK(is.time_covariance == was.time_covariance);
        CHECK(is.code == was.code);
    }
    CHECK(read.missing == file.search.missing);
    CHECK(read.candidates == 12);
    CHECK(read.rejected == 4);
    CHECK(read.spline_map);
    CHECK(read.reading_covariance == file.search.reading_covariance);
    CHECK(read.remarks == file.search.remarks);
    CHECK(reading.file->head.phase == 0.1);
    CHECK(reading.file->head.fingerprint.sha256 == file.head.fingerprint.sha256);
    CHECK(reading.file->head.fingerprint.keys == file.head.fingerprint.keys);
}

TEST_CASE("period and points are enough", "[apps]") {
    const auto reading = parsed(R"({"cycles": [{"period": 1, "points": [[4.0, 6.4]], "covariance": null}]})");
    REQUIRE(reading.file);
    const auto& cycle = reading.file->search.cycles.at(0);
    CHECK(cycle.period == 1);
    CHECK(cycle.points(0, 0) == models::wrapped(4.0));  // angles are brought onto the circle
    CHECK(cycle.points(1, 0) == 6.4);
    CHECK(cycle.rotation.empty());
    CHECK(cycle.covariance.size() == 0);
    CHECK_FALSE(cycle.mirror);
    CHECK(reading.file->head.coordinates.at(1).name == "phi_dot");
    CHECK(reading.file->head.fingerprint.sha256.empty());
}

TEST_CASE("a covariance that was printed with few digits is symmetric", "[apps]") {
    const auto reading =
        parsed(R"({"cycles": [{"period": 1, "points": [[1, 2]], "covariance": [[2, 1.0000001], [1.0000002, 3]]}]})");
    REQUIRE(reading.file);
    const Eigen::MatrixXd& covariance = reading.file->search.cycles[0].covariance;
    CHECK(covariance(0, 1) == covariance(1, 0));
    CHECK(covariance(0, 0) == 2.0);
}

TEST_CASE("of computed orbits only those that converged are cycles", "[apps]") {
    const auto reading = parsed(R"({ "cycles": [
        { "period": 1, "points": [[0.1, 3.0]], "status": "no_progress", "message": "", "mirror": 2 },
        { "period": 1, "points": [[0.2, 4.0]], "status": "converged", "mirror": 3 },
        { "period": 1, "points": [[-0.1, -3.0]], "status": "converged", "mirror": 0 },
        { "period": 1, "points": [[-0.2, -4.0]], "status": "converged", "mirror": 1 } ] })");
    REQUIRE(reading.file);
    const auto& cycles = reading.file->search.cycles;
    REQUIRE(cycles.size() == 3);
    CHECK(cycles[0].mirror == 2);
    CHECK(cycles[2].mirror == 0);
    CHECK_FALSE(cycles[1].mirror);
    CHECK(cycles[1].points(0, 0) == -0.1);
}

TEST_CASE("what is wrong with a list of cycles is told by place and rule", "[apps]") {
    struct Case {
        std::string text;
        std::string pointer;
        std::size_t line;
        std::string rule;
    };
    const std::string good = R"({"period": 1, "points": [[1, 2]])";
    const Case cases[] = {
        {"{\"cycles\": [\n{\"points\": [[1, 2]]}]}", "/cycles/0", 2, "\"period\" is missing"},
        {"{\"cycles\": [\n{\"period\": 2, \"points\": [[1, 2]]}]}", "/cycles/0/points", 2, "as many as the period, 2"},
        {"{\"cycles\": [{\"period\": 1,\n\"points\": [[1, 2, 3]]}]}", "/cycles/0/points/0", 2, "must have 2"},
        {"{\"cycles\": [{\"period\": 1,\n\"points\": [[1, null]]}]}", "/cycles/0/points", 2, "must hold numbers"},
        {"{\"cycles\": [{\"period\": 1,\n\"points\": [[1, 1e300]]}]}", "/cycles/0/points", 2, "must lie within 1e100"},
        {"{\"cycles\": [{\"period\": 1,\n\"points\": [[1, \"2\"]]}]}", "/cycles/0/points/0/1", 2, "must be a number"},
        {"{\"cycles\": [{\"period\": 1.5, \"points\": []}]}", "/cycles/0/period", 1, "whole number"},
        {"{\"cycles\": [" + good + ", \"covariance\": [[1, 0], [0, -1]]}]}", "/cycles/0/covariance", 1, "variance"},
        {"{\"cycles\": [" + good + ", \"covariance\": [[1, 1], [0, 1]]}]}", "/cycles/0/covariance", 1, "symmetric"},
        {"{\"cycles\": [" + good + ", \"covariance\": [[1]]}]}", "/cycles/0/covariance", 1, "must have 2"},
        {"{\"cycles\": [" + good + ", \"time_covariance\": [0]}]}", "/cycles/0/time_covariance", 1, "must have 2"},
        {"{\"cycles\": [" + good + ", \"time_covariance\": [0, null]}]}", "/cycles/0/time_covariance", 1,
         "must hold numbers"},
        {"{\"cycles\": [" + good + ", \"time_covariance\": 1}]}", "/cycles/0/time_covariance", 1, "must be a list"},
        {"{\"cycles\": [" + good + ", \"common_errors\": [[1], [1], [1], [1]]}]}", "/cycles/0/common_errors", 1,
         "must have 2"},
        {"{\"cycles\": [" + good + ", \"rotation\": [1, 0]}]}", "/cycles/0/rotation", 1, "one per angle"},
        {"{\"cycles\": [" + good + ", \"mirror\": 1}]}", "/cycles/0/mirror", 1, "from 0 to 0"},
        {"{\"cycles\": [" + good + ", \"perod\": 1}]}", "/cycles/0/perod", 1, "did you mean \"period\""},
        {"{\n\"format\": \"orbid-cycles/2\", \"cycles\": []}", "/format", 2, "orbid-cycles/1"},
        {"{\"model\": \"duffing\", \"cycles\": []}", "/model", 1, "must be of \"parametric_pendulum\""},
        {R"({"coordinates": ["phi", "v"], "cycles": []})", "/coordinates", 1, "must be [\"phi\", \"phi_dot\"]"},
        {R"({"units": ["deg", "rad/s"], "cycles": []})", "/units", 1, "must be [\"rad\", \"rad/s\"]"},
        {"{\"orbits\": []}", "", 1, "\"cycles\" is missing"},
        {"[]", "", 1, "must be an object"},
    };
    for (const Case& wrong : cases) {
        CAPTURE(wrong.text);
        const auto reading = parsed(wrong.text);
        CHECK_FALSE(reading.file);
        REQUIRE_FALSE(reading.problems.empty());
        CHECK(reading.problems.front().pointer == wrong.pointer);
        CHECK(reading.problems.front().place.line == wrong.line);
        CHECK_THAT(reading.problems.front().rule, ContainsSubstring(wrong.rule));
    }
}

TEST_CASE("a file that is missing or wrong is named with every problem", "[apps]") {
    const tests::TemporaryFolder folder;
    const auto path = folder.path() / "cycles.json";
    CHECK_THROWS_AS(apps::read_cycles(path, pendulum->name(), apps::series_coordinates(*pendulum)), orbits::DataError);
    apps::write_atomically(path, std::string_view("{\"cycles\": [{\"period\": 0,\n\"points\": [[1, 2]], \"x\": 1}]}"));
    CHECK_THROWS_WITH(apps::read_cycles(path, pendulum->name(), apps::series_coordinates(*pendulum)),
                      ContainsSubstring(path.string() + ":1:24: /cycles/0/period") &&
                          ContainsSubstring(path.string() + ":2:21: /cycles/0/x"));
}

TEST_CASE("a stored fingerprint that was tampered with counts as none", "[apps]") {
    auto json = nlohmann::ordered_json::parse(apps::cycles_text(two_cycles()));
    json["fingerprint"]["keys"][0][1] = "2";
    const auto reading = parsed(json.dump());
    REQUIRE(reading.file);
    CHECK(reading.file->head.fingerprint.sha256.empty());
}

TEST_CASE("cycles of a wrong shape are not written", "[apps]") {
    auto file = two_cycles();
    file.search.cycles[1].period = 3;
    CHECK_THROWS_WITH(apps::cycles_text(file), ContainsSubstring("cycle 1") && ContainsSubstring("(2, 3)"));
    file = two_cycles();
    file.search.cycles[0].covariance.resize(3, 3);
    CHECK_THROWS_AS(apps::cycles_text(file), std::invalid_argument);
    file = two_cycles();
    file.search.cycles[1].time_covariance.resize(3);
    CHECK_THROWS_AS(apps::cycles_text(file), std::invalid_argument);
}

}  // namespace
}  // namespace orbid::cycle_file_test
