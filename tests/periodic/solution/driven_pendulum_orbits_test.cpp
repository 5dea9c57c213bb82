#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numbers>

#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace driven_pendulum_orbits_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using periodic::OrbitStatus;

// tests/reference/driven_pendulum_orbits.json: extended precision; the small multiplier from the product, which is
// exactly exp(-gamma p T).
TEST_CASE("torque-driven pendulum: both multipliers of orbits up to period 8", "[periodic][reference]") {
    const auto system = models::make_system("driven_pendulum");
    const auto theta = system->default_parameters();
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/driven_pendulum_orbits.json");
    const auto table = nlohmann::json::parse(stream);
    int solved = 0;
    for (const auto& entry : table.at("cycles")) {
        const auto number = [&](const char* key) { return std::stod(entry.at(key).get<std::string>()); };
        const int p = entry.at("period");
        CAPTURE(p, number("unstable_multiplier"));
        const Eigen::Vector2d first(number("theta_0"), number("theta_dot_0"));
        MatrixXd guess = system->ensemble(first, 0.0, static_cast<std::size_t>(p), theta).sections[0].leftCols(p);
        for (Index j = 0; j < p; ++j) {
            guess(0, j) += 1e-3 * std::sin(5.0 * static_cast<double>(j) + 1.0);
            guess(1, j) += 1e-3 * std::cos(3.0 * static_cast<double>(j));
        }
        periodic::ShootingOptions options;
        options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
        const auto orbit = solve_multiple_shooting(*system, theta, 0.0, guess, {}, {}, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(orbit.rotation == std::vector<int>{entry.at("rotation").get<int>()});
        CHECK(std::abs(models::wrapped(orbit.points(0, 0) - first(0))) < 1e-11);
        CHECK(std::abs(orbit.points(1, 0) - first(1)) < 1e-11);
        CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(number("unstable_multiplier"), 2e-11));
        // Asked for: 1e-9. Worst measured 1.7e-12 and, of the product, 2.2e-13.
        // The table gives nine or ten digits of the small one; the identity all.
        CHECK_THAT(orbit.multipliers[1].real(), tests::WithinRel(number("stable_multiplier"), 3e-9));
        const double product = orbit.multipliers[0].real() * orbit.multipliers[1].real();
        const double expected = std::exp(-0.2 * p * 3.0 * std::numbers::pi);
        CHECK_THAT(product, tests::WithinRel(expected, 3e-12));
        ++solved;
    }
    CHECK(solved == 7);
}

// tests/reference/driven_pendulum_long.json: 18 digits of points and both multipliers, computed in 113 bits without the
// library.
TEST_CASE("torque-driven pendulum: both multipliers of orbits of periods 9 to 12", "[periodic][reference]") {
    const auto system = models::make_system("driven_pendulum");
    const auto theta = system->default_parameters();
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/driven_pendulum_long.json");
    const auto table = nlohmann::json::parse(stream);
    int solved = 0;
    double worst_point = 0.0, worst_unstable = 0.0, worst_stable = 0.0;
    for (const auto& entry : table.at("cycles")) {
        const auto number = [](const nlohmann::json& value) { return std::stod(value.get<std::string>()); };
        const Index p = entry.at("period");
        const double unstable = number(entry.at("unstable_multiplier"));
        CAPTURE(p, unstable);
        MatrixXd exact(2, p);
        for (Index j = 0; j < p; ++j)
            for (Index i = 0; i < 2; ++i)
                exact(i, j) =
                    number(entry.at("points").at(static_cast<std::size_t>(j)).at(static_cast<std::size_t>(i)));
        MatrixXd guess = exact;
        for (Index j = 0; j < p; ++j) {
            guess(0, j) += 1e-3 * std::sin(5.0 * static_cast<double>(j) + 1.0);
            guess(1, j) += 1e-3 * std::cos(3.0 * static_cast<double>(j));
        }
        periodic::ShootingOptions options;
        options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-14;
        const auto orbit = solve_multiple_shooting(*system, theta, 0.0, guess, {}, {}, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(orbit.rotation == std::vector<int>{entry.at("rotation").get<int>()});
        for (Index j = 0; j < p; ++j) {
            worst_point = std::max(worst_point, std::abs(models::wrapped(orbit.points(0, j) - exact(0, j))));
            worst_point = std::max(worst_point, std::abs(orbit.points(1, j) - exact(1, j)));
        }
        worst_unstable = std::max(worst_unstable, std::abs(orbit.multipliers[0].real() / unstable - 1.0));
        const double stable = number(entry.at("stable_multiplier"));
        worst_stable = std::max(worst_stable, std::abs(orbit.multipliers[1].real() / stable - 1.0));
        ++solved;
    }
    CHECK(solved == 16);
    // Asked for: 1e-9. Multipliers of size 2e3 to 2e8 and 1e-18 to 6e-12. Measured 1e-13, 4.4e-12 and 4.4e-12, which is
    // what the error of the points makes of the derivatives; times ten.
    CHECK(worst_point < 1e-12);
    CHECK(worst_unstable < 5e-11);
    CHECK(worst_stable < 5e-11);
}

}  // namespace driven_pendulum_orbits_test
