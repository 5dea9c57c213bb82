#include "models/catalogue/lorenz.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/lyapunov.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::lorenz_test {

static_assert(SymmetricModel<Lorenz>);

using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("the Lorenz orbit AB closes, with its derivatives", "[models][reference]") {
    // 50 digits by TIDES (A. Abad, R. Barrio, A. Dena, Physical Review E 84, 016701, 2011), here rounded to 20;
    // derivatives of the state after one period, independently to 18 and (rho) 9 digits.
    const double period = 1.5586522107161747276;
    const Eigen::Vector3d start(-13.763610682134200525, -19.578751942451795539, 27.0);
    Eigen::Matrix3d expected;
    expected.col(0) << -0.912802195703595109, -0.130905810340089968, 1.67609907947194769;
    expected.col(1) << -3.67561474, 1.58865477, 15.11224225;
    expected.col(2) << -28.2268059307864192, 18.1841834628623644, 116.876988007583165;
    const auto system = make_system("lorenz");
    const std::vector<Eigen::Index> free{0, 1, 2};
    const auto flow = system->flow_with_sensitivities(start, 0.0, std::array{period}, system->default_parameters(),
                                                      free, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    // Measured 2.1e-11, 1.9e-11 and 4.8e-10, times ten; derivatives to rho are known to half a unit in the last place.
    CHECK((flow.states.col(0) - start).cwiseAbs().maxCoeff() < 2.1e-10);
    const Eigen::Matrix3d parameters = flow.sensitivities.rightCols(3);
    CHECK((parameters - expected).col(0).cwiseAbs().maxCoeff() < 1.9e-10);
    CHECK((parameters - expected).col(2).cwiseAbs().maxCoeff() < 4.8e-9);
    CHECK((parameters - expected).col(1).cwiseAbs().maxCoeff() < 5e-9);
}

TEST_CASE("the tabulated cycles of the Lorenz equations close, with their multipliers", "[models][reference]") {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/lorenz_orbits.json");
    const auto table = nlohmann::json::parse(in);
    const auto system = make_system("lorenz");
    const auto number = [](const nlohmann::json& cycle, const char* key) {
        return std::stod(cycle[key].get<std::string>());
    };
    REQUIRE(table["cycles"].size() == 10);
    double worst_gap = 0.0, worst_multiplier = 0.0;
    for (const auto& cycle : table["cycles"]) {
        const Eigen::Vector3d start(number(cycle, "x"), number(cycle, "y"), 27.0);
        const double unstable = number(cycle, "unstable_multiplier");
        const auto flow = system->flow_with_sensitivities(start, 0.0, std::array{number(cycle, "period")},
                                                          system->default_parameters(), {}, Clock::time);
        worst_gap = std::max(worst_gap, (flow.states.col(0) - start).norm() / unstable);
        // Multipliers unstable, 1 and one so small that it is lost in rounding: the trace is the sum of the others.
        const double trace = flow.sensitivities.leftCols(3).trace();
        const double stable = std::exp(-(10.0 + 1.0 + 8.0 / 3.0) * number(cycle, "period")) / unstable;
        worst_multiplier = std::max(worst_multiplier, std::abs(trace - 1.0 - stable - unstable) / unstable);
    }
    // Measured 3.9e-11 and 4.2e-10, times ten.
    CHECK(worst_gap < 3.9e-10);
    CHECK(worst_multiplier < 4.2e-9);
}

TEST_CASE("rolls of the Lorenz equations lose their stability where they should", "[models][reference]") {
    // Equilibria x = y = +-sqrt(beta (rho - 1)), z = rho - 1; at rho = sigma (sigma + beta + 3) / (sigma - beta - 1)
    // their eigenvalues are +-i sqrt(beta (sigma + rho)) and -(sigma + beta + 1), from the characteristic polynomial.
    const auto system = make_system("lorenz");
    const double sigma = 10.0, beta = 8.0 / 3.0, rho = sigma * (sigma + beta + 3.0) / (sigma - beta - 1.0);
    const Eigen::Vector3d theta(sigma, rho, beta);
    const double root = std::sqrt(beta * (rho - 1.0));
    const double turn = 2.0 * std::numbers::pi / std::sqrt(beta * (sigma + rho));
    for (const double sign : {1.0, -1.0}) {
        const Eigen::Vector3d rolls(sign * root, sign * root, rho - 1.0);
        CHECK(system->at_rest(rolls, theta));
        const auto flow = system->flow_with_sensitivities(rolls, 0.0, std::array{turn}, theta, {}, Clock::time);
        const Eigen::Matrix3d X = flow.sensitivities;
        // X - 1 leaves only the fast decaying direction: rank one, with this trace. Some twenty steps of 1e-12 each,
        // on entries of size ten.
        const double decay = std::exp(-(sigma + beta + 1.0) * turn);
        CHECK_THAT(X.trace(), WithinAbs(2.0 + decay, 1e-9));
        CHECK_THAT(X.determinant(), WithinAbs(decay, 1e-9));
        const Eigen::Matrix3d rest = X - Eigen::Matrix3d::Identity();
        CHECK((rest * rest - (decay - 1.0) * rest).norm() < 1e-8);
    }
}

TEST_CASE("the Lorenz equations have their Lyapunov exponent", "[models][reference]") {
    // 0.9056 (J. C. Sprott, Chaos and Time-Series Analysis, 2003).
    const auto system = make_system("lorenz");
    const auto exponent = tests::largest_exponent(*system, Eigen::Vector3d(1.0, 2.0, 20.0),
                                                  system->default_parameters(), 0.5, 200, 40, Clock::time);
    CHECK(exponent.standard_error < 0.01);
    CHECK_THAT(exponent.mean, WithinAbs(0.9056, 4.0 * exponent.standard_error));
}

}  // namespace orbid::models::lorenz_test
