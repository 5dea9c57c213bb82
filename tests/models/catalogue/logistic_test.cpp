#include "models/catalogue/logistic.hpp"

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/lyapunov.hpp"

namespace orbid::models::logistic_test {

static_assert(MapModel<Logistic>);

using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("cycles of the logistic map with r = 4 have the multipliers +-2^p", "[models][reference]") {
    // x = sin^2(pi u) makes it u -> 2 u: u = k / (2^p - 1) returns after p steps with the slope 2^p, u = k / (2^p + 1)
    // as -u, which is the same x, with the slope -2^p.
    const auto system = make_system("logistic");
    const Eigen::VectorXd theta = system->default_parameters();
    REQUIRE(theta[0] == 4.0);
    int cycles = 0;
    for (int p = 1; p <= 8; ++p)
        for (const double sign : {1.0, -1.0}) {
            const double denominator = std::pow(2.0, p) - sign;
            for (int k = 1; k < denominator / 2.0; ++k) {
                CAPTURE(p, sign, k);
                const double x = std::pow(std::sin(std::numbers::pi * k / denominator), 2);
                const auto flow = system->flow_with_sensitivities(
                    Eigen::VectorXd::Constant(1, x), 0.0, std::array{static_cast<double>(p)}, theta, {}, Clock::time);
                // Next to 1 rounding is stretched by 4 a step until x is back in the middle: 4^p in all; the slope
                // there is twice the distance from the fold, 2^-p or so.
                CHECK_THAT(flow.states(0, 0), WithinAbs(x, 1e-16 * std::pow(4.0, p)));
                CHECK_THAT(flow.sensitivities(0, 0), WithinRel(sign * std::pow(2.0, p), 1e-16 * std::pow(8.0, p)));
                ++cycles;
            }
        }
    // (2^p - 2) / 2 + 2^p / 2 points other than 0 for each p.
    CHECK(cycles == 502);
    // The fixed point 0 is the exception: slope r.
    const auto zero = system->flow_with_sensitivities(Eigen::VectorXd::Zero(1), 0.0, std::array{1.0}, theta,
                                                      std::vector<Eigen::Index>{0}, Clock::time);
    CHECK(zero.states(0, 0) == 0.0);
    CHECK(zero.sensitivities == Eigen::RowVector2d(4.0, 0.0));
}

TEST_CASE("the logistic map doubles its period where it should", "[models][reference]") {
    // The fixed point 1 - 1/r has the slope 2 - r, the 2-cycle 4 + 2 r - r^2: -1 at r = 3 and 1 + sqrt 6.
    const auto system = make_system("logistic");
    for (const double r : {3.0, 3.7, 1.0 + std::sqrt(6.0)}) {
        const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, r);
        const auto slope = [&](double x, double period) {
            const auto flow = system->flow_with_sensitivities(Eigen::VectorXd::Constant(1, x), 0.0, std::array{period},
                                                              theta, {}, Clock::time);
            CHECK_THAT(flow.states(0, 0), WithinAbs(x, 1e-14));
            return flow.sensitivities(0, 0);
        };
        CHECK_THAT(slope(1.0 - 1.0 / r, 1.0), WithinAbs(2.0 - r, 1e-14));
        const double x = (r + 1.0 + std::sqrt((r + 1.0) * (r - 3.0))) / (2.0 * r);
        CHECK_THAT(slope(x, 2.0), WithinAbs(4.0 + 2.0 * r - r * r, 1e-13));
    }
}

TEST_CASE("the logistic map with r = 4 has the exponent ln 2", "[models][reference]") {
    const auto system = make_system("logistic");
    const auto exponent = tests::largest_exponent(*system, Eigen::VectorXd::Constant(1, 0.3),
                                                  system->default_parameters(), 10.0, 100, 100, Clock::time);
    CHECK(exponent.standard_error < 0.001);
    CHECK_THAT(exponent.mean, WithinAbs(std::numbers::ln2, 4.0 * exponent.standard_error));
}

}  // namespace orbid::models::logistic_test
