#include "apps/results/orbit_file.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include "apps/results/cycle_reader.hpp"
#include "apps/results/periodic_summary.hpp"
#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::orbit_file_test {
namespace {

using tests::ContainsSubstring;

const auto pendulum = models::make_system("parametric_pendulum");

apps::CycleFileHead head() {
    return {"parametric_pendulum",
            apps::series_coordinates(*pendulum),
            0.1,
            std::nullopt,
            2.0 / 3.0,
            apps::fingerprint({{"/seed", "1"}})};
}

apps::ComputedOrbit orbit_of_two() {
    apps::ComputedOrbit computed;
    periodic::PeriodicOrbit& orbit = computed.orbit;
    orbit.status = periodic::OrbitStatus::converged;
    orbit.period = 2;
    orbit.rotation = {1};
    orbit.points = Eigen::MatrixXd::Constant(2, 2, 1.0 / 3.0);
    orbit.points(0, 1) = -2.0 / 7.0;
    orbit.multipliers = {{-2.0, 0.0}, {0.0, 0.0}};  // an exact zero, as after sticking
    orbit.residual = 1e-13;
    orbit.distance = 1.0 / 7.0;
    orbit.sensitivities = Eigen::MatrixXd::Constant(4, 1, 0.25);
    return computed;
}

TEST_CASE("orbits.json is a list of cycles with residual, status and sensitivities", "[apps]") {
    const std::string text = apps::orbits_text(head(), {{orbit_of_two()}}, {"l"});
    const auto json = nlohmann::json::parse(text);
    const auto& written = json["cycles"][0];
    CHECK(written["status"] == "converged");
    CHECK(written["message"].is_null());
    CHECK(written["residual"] == 1e-13);
    CHECK(written["sensitivities"].size() == 4);
    CHECK(written["ln_multiplier"][0] == std::log(2.0));
    CHECK(written["ln_multiplier"][1].is_null());
    CHECK(written["time"] == 2.0 * (2.0 / 3.0));
    CHECK_FALSE(written.contains("times"));
    CHECK_FALSE(written.contains("hits"));
    CHECK(json["parameters"] == nlohmann::json({"l"}));

    const auto reading = apps::parse_cycles(text, pendulum->name(), apps::series_coordinates(*pendulum));
    CAPTURE(reading.problems.empty() ? "" : reading.problems.front().rule);
    REQUIRE(reading.file);
    CHECK(reading.file->search.cycles.at(0).points == orbit_of_two().orbit.points);
    CHECK(std::isnan(reading.file->search.cycles.at(0).ln_multiplier[1]));
}

TEST_CASE("what a search and stability add to orbits.json is written, and skipped as cycles", "[apps]") {
    apps::ComputedOrbits orbits{{orbit_of_two(), orbit_of_two()}, true, 12, 3, false};
    orbits.list[0].origin = orbits.list[1].origin = "recurrence";
    orbits.list[0].mirror = 1;
    orbits.list[1].mirror = 0;
    orbits.list[1].hits = 5;
    orbits.unsettled = {2};
    orbits.index_sums = {0, 4};
    periodic::Stability stability;
    stability.unstable = 1;
    stability.nearest = periodic::Bifurcation::period_doubling;
    stability.directions.assign(2, Eigen::MatrixXcd::Constant(2, 2, {0.5, -0.25}));
    stability.ln_multiplier_sensitivities = Eigen::MatrixXd::Constant(2, 1, 3.0);
    orbits.list[0].stability = stability;
    const std::string text = apps::orbits_text(head(), orbits, {"l"});
    const auto json = nlohmann::json::parse(text);
    CHECK(json["search"] ==
          nlohmann::json::parse(R"({ "starts": 12, "captured": 3, "unsettled": [2], "index_sums": [0, 4] })"));
    const auto stored = apps::stored_orbits(text);
    REQUIRE(stored);
    CHECK(stored->orbits.unsettled == orbits.unsettled);
    CHECK(stored->orbits.index_sums == orbits.index_sums);
    const auto& first = json["cycles"][0];
    CHECK(first["unstable"] == 1);
    CHECK(first["bifurcation_near"] == std::string(periodic::name(periodic::Bifurcation::period_doubling)));
    CHECK(first["directions"][1][0][1] == nlohmann::json({0.5, -0.25}));
    CHECK(first["ln_multiplier_sensitivities"] == nlohmann::json::parse("[[3.0], [3.0]]"));
    CHECK(json["cycles"][1]["hits"] == 5);
    CHECK(json["cycles"][1]["mirror"] == 0);
    CHECK(apps::parse_cycles(text, pendulum->name(), apps::series_coordinates(*pendulum)).file);
}

TEST_CASE("stored orbits are read back for the next stages", "[apps]") {
    apps::ComputedOrbits orbits{{orbit_of_two(), orbit_of_two(), orbit_of_two()}, true, 12, 3, false};
    orbits.list[1].orbit.status = periodic::OrbitStatus::other_orbit;
    orbits.list[1].message = "an orbit of period 1";
    orbits.list[2].computed = false;
    orbits.list[2].mirror = 2;
    const std::string text = apps::orbits_text(head(), orbits, {"l"});
    const auto stored = apps::stored_orbits(text);
    REQUIRE(stored);
    CHECK(apps::fingerprint_from_text(stored->fingerprint).has_value());
    CHECK(stored->orbits.converged() == 1);
    CHECK(stored->orbits.starts == 12);
    REQUIRE(stored->orbits.list.size() == 3);
    CHECK(stored->orbits.list[0].orbit.points == orbit_of_two().orbit.points);
    CHECK(stored->orbits.list[0].orbit.multipliers == orbit_of_two().orbit.multipliers);
    CHECK(stored->orbits.list[0].orbit.distance == 1.0 / 7.0);
    CHECK(stored->orbits.list[1].message == "an orbit of period 1");
    CHECK(stored->orbits.list[2].status() == "interrupted");
    CHECK(stored->orbits.list[2].mirror == 2);
    // The summary of what was read is that of what was computed.
    CHECK(apps::orbits_summary(stored->orbits) == apps::orbits_summary(orbits));
    CHECK_FALSE(apps::stored_orbits("{\"cycles\": [{}]}"));
    CHECK_FALSE(apps::stored_orbits("no json"));
    for (int status = 0; status <= static_cast<int>(periodic::OrbitStatus::period_vanished); ++status) {
        const auto name = periodic::name(static_cast<periodic::OrbitStatus>(status));
        CHECK(apps::detail::named(name, periodic::OrbitStatus::period_vanished) ==
              static_cast<periodic::OrbitStatus>(status));
    }
}

TEST_CASE("orbits of a wrong shape are not written", "[apps]") {
    apps::ComputedOrbit wrong = orbit_of_two();
    wrong.orbit.sensitivities = Eigen::MatrixXd::Zero(2, 3);
    CHECK_THROWS_AS(apps::orbits_text(head(), {{wrong}}, {"l"}), std::invalid_argument);
    wrong = orbit_of_two();
    wrong.orbit.period = 3;
    CHECK_THROWS_WITH(apps::orbits_text(head(), {{wrong}}, {"l"}), ContainsSubstring("(2, 3)"));
}

TEST_CASE("computed orbits are listed one by one, with what was found instead", "[apps]") {
    apps::ComputedOrbit computed;
    periodic::PeriodicOrbit& orbit = computed.orbit;
    orbit.status = periodic::OrbitStatus::converged;
    orbit.period = 1;
    orbit.rotation = {1};
    orbit.points = Eigen::Vector2d(2.966784281971485, 6.406582448046664);
    orbit.multipliers = {{-1.70923411992, 0.0}, {-0.426625, 0.25}};
    orbit.residual = 3e-14;
    apps::ComputedOrbit other = orbit_of_two();
    other.orbit.status = periodic::OrbitStatus::other_orbit;
    other.message = apps::orbit_message(other.orbit);
    const std::string text = apps::orbits_summary({{computed, other}});
    for (const char* words :
         {"converged", "+1", "2.96678428, 6.40658245", "-1.70923, -0.426625+0.25i", "3e-14",
          "orbit 1: farther than \"maximum_distance\": an orbit of period 2 with rotation +1 through (0.333333, "
          "0.333333), 0.14 of the scale from the start"}) {
        CHECK_THAT(text, ContainsSubstring(words));
    }
}

TEST_CASE("found orbits are counted by period", "[apps]") {
    apps::ComputedOrbits orbits{{orbit_of_two(), orbit_of_two(), orbit_of_two()}, true, 12, 0, false};
    for (apps::ComputedOrbit& orbit : orbits.list)
        orbit.origin = "recurrence";
    orbits.list[0].mirror = 1;
    orbits.list[1].mirror = 0;
    orbits.list[2].mirror = 2;
    const std::string text = apps::orbits_summary(orbits);
    CHECK_THAT(text, ContainsSubstring("     2       3             1          1  2 ... 2               recurrence 3"));
    CHECK_THAT(apps::orbits_summary({{}, true, 12, 0, false}), ContainsSubstring("none found: of 12 solved starts"));
    CHECK_THAT(apps::orbits_summary({{}, true, 0, 0, false}), ContainsSubstring("none found: in none of the periods"));
    CHECK_THAT(text, !ContainsSubstring("missing") && !ContainsSubstring("more \"points\""));
    orbits.index_sums = {0, 0};
    CHECK_THAT(apps::orbits_summary(orbits), !ContainsSubstring("missing"));
    orbits.index_sums = {0, 4, 15};
    orbits.unsettled = {2, 3};
    orbits.interrupted = true;
    CHECK_THAT(apps::orbits_summary(orbits),
               ContainsSubstring("indices of the periods 1 to 3 add up to 0, 4, 15") &&
                   ContainsSubstring("periods 2, 3: the last starts still led to new orbits") &&
                   ContainsSubstring("the search was interrupted"));
}

}  // namespace
}  // namespace orbid::orbit_file_test
