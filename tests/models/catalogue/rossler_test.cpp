#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/closed_orbit.hpp"
#include "tests/models/catalogue/lyapunov.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::rossler_test {

using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("the tabulated cycles of the Roessler equations close after their periods, with their multipliers",
          "[models][reference]") {
    // Three periods have been verified by interval arithmetic: code and bounds.
    struct Verified {
        std::string code;
        double lower, upper;
    };
    const std::vector<Verified> verified{{"1", 5.8810884555538525, 5.8810884555539493},
                                         {"01", 11.758626071659574, 11.758626071660617},
                                         {"001", 17.515791070334913, 17.515791070336615}};
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/rossler_orbits.json");
    const auto table = nlohmann::json::parse(in);
    const auto number = [](const nlohmann::json& cycle, const char* key) {
        return std::stod(cycle[key].get<std::string>());
    };
    const auto system = make_system("rossler");
    const Eigen::VectorXd theta = system->default_parameters();
    double worst_start = 0.0, worst_period = 0.0, worst_multiplier = 0.0;
    std::size_t found = 0;
    REQUIRE(table["cycles"].size() == 14);
    for (const auto& cycle : table["cycles"]) {
        const auto code = cycle["code"].get<std::string>();
        CAPTURE(code);
        const Eigen::Vector3d start(0.0, number(cycle, "y"), number(cycle, "z"));
        const double unstable = number(cycle, "unstable_multiplier"), period = number(cycle, "period");
        const auto closed = tests::closed_orbit(*system, theta, start, period, 0);
        worst_start = std::max(worst_start, (closed.start - start).norm());
        worst_period = std::max(worst_period, std::abs(closed.period - period));
        // Multipliers unstable, 1 and one of the size exp(-5.4 T) that is lost in rounding: the trace is their sum.
        worst_multiplier = std::max(worst_multiplier, std::abs((closed.monodromy.trace() - 1.0) / unstable - 1.0));
        for (const Verified& v : verified) {
            if (v.code != code) continue;
            ++found;
            CHECK((v.lower <= period && period <= v.upper));
            // Measured at most 2.7e-12, times ten.
            CHECK_THAT(closed.period, WithinAbs(0.5 * (v.lower + v.upper), 2.7e-11));
        }
    }
    CHECK(found == 3);
    // Measured 4.4e-11, 9.1e-12 and 9.4e-11, times ten.
    CHECK(worst_start < 4.4e-10);
    CHECK(worst_period < 9.1e-11);
    CHECK(worst_multiplier < 9.4e-10);
}

TEST_CASE("the equilibria of the Roessler equations are at rest", "[models][fast]") {
    const auto system = make_system("rossler");
    const Eigen::VectorXd theta = system->default_parameters();
    const double a = theta[0], b = theta[1], c = theta[2];
    for (const double sign : {1.0, -1.0}) {
        const double x = 0.5 * (c + sign * std::sqrt(c * c - 4.0 * a * b));
        // Roundings of numbers up to 160.
        CHECK(system->rhs(Eigen::Vector3d(x, -x / a, x / a), std::array{0.0}, theta).norm() < 1e-13);
    }
}

TEST_CASE("the Roessler equations have their Lyapunov exponent", "[models][reference]") {
    // 0.0714 (J. C. Sprott, Chaos and Time-Series Analysis, 2003).
    const auto system = make_system("rossler");
    const auto exponent = tests::largest_exponent(*system, Eigen::Vector3d(-9.0, 0.0, 0.0),
                                                  system->default_parameters(), 5.0, 200, 20, Clock::time);
    CHECK(exponent.standard_error < 0.003);
    CHECK_THAT(exponent.mean, WithinAbs(0.0714, 4.0 * exponent.standard_error));
}

}  // namespace orbid::models::rossler_test
