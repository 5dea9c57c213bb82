#include <Eigen/LU>
#include <cmath>
#include <complex>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/closed_orbit.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::fitzhugh_nagumo_test {

using tests::WithinAbs;
using tests::WithinRel;

namespace {

/// Equilibrium in closed form, b < 1: v^3 + 3 (1/b - 1) v + 3 (a/b - I) = 0 has one real root (hyperbolic form of
/// Cardano's).
Eigen::Vector2d equilibrium(const Eigen::Vector4d& theta) {
    const double a = theta[0], b = theta[1], current = theta[3];
    const double p = 3.0 * (1.0 / b - 1.0), q = 3.0 * (a / b - current);
    const double v = -2.0 * std::sqrt(p / 3.0) * std::sinh(std::asinh(1.5 * q / p * std::sqrt(3.0 / p)) / 3.0);
    return {v, (v + a) / b};
}

}  // namespace

TEST_CASE("a nerve cell without current rests where it should", "[models][reference]") {
    const auto system = make_system("fitzhugh_nagumo");
    Eigen::Vector4d theta = system->default_parameters();
    theta[3] = 0.0;
    const Eigen::Vector2d rest = equilibrium(theta);
    // -1.1994, -0.6243: the resting point for a = 0.7, b = 0.8 that the literature quotes.
    CHECK_THAT(rest[0], WithinAbs(-1.1994, 5e-5));
    CHECK_THAT(rest[1], WithinAbs(-0.6243, 5e-5));
    CHECK(system->rhs(rest, std::array{0.0}, theta).norm() < 1e-15);
    CHECK(system->at_rest(rest, theta));
    // It is stable: eigenvalues have the real part (1 - v^2 - epsilon b) / 2 = -0.25, so 1e-2 shrinks by e^-50.
    const auto flow = system->flow(rest + Eigen::Vector2d(0.01, 0.0), 0.0, std::array{200.0}, theta, Clock::time);
    CHECK((flow.states.col(0) - rest).norm() < 1e-11);
}

TEST_CASE("a nerve cell begins to oscillate at the Hopf point", "[models][reference]") {
    // Trace 0: v = -sqrt(1 - epsilon b), there omega^2 = epsilon - (epsilon b)^2; I from the equilibrium (0.3313).
    const auto system = make_system("fitzhugh_nagumo");
    Eigen::Vector4d theta = system->default_parameters();
    const double a = theta[0], b = theta[1], epsilon = theta[2];
    const double v = -std::sqrt(1.0 - epsilon * b), w = (v + a) / b;
    theta[3] = w - v + v * v * v / 3.0;
    CHECK_THAT(theta[3], WithinAbs(0.3313, 5e-5));
    const double omega = std::sqrt(epsilon - epsilon * epsilon * b * b);
    Eigen::Matrix2d J;
    J << 1.0 - v * v, -1.0, epsilon, -epsilon * b;
    for (const double part : {0.25, 1.0}) {
        const double turn = 2.0 * std::numbers::pi * part;
        const auto flow = system->flow_with_sensitivities(Eigen::Vector2d(v, w), 0.0, std::array{turn / omega}, theta,
                                                          {}, Clock::time);
        // exp(J t) = cos(omega t) + J sin(omega t) / omega, as J^2 = -omega^2. A few steps of 1e-12, entries up to 4.
        const Eigen::Matrix2d expected = std::cos(turn) * Eigen::Matrix2d::Identity() + std::sin(turn) / omega * J;
        CHECK((flow.sensitivities - expected).norm() < 1e-10);
    }
}

TEST_CASE("a nerve cell under current fires with its known period", "[models][reference]") {
    // Extrapolation in 40 digits: tests/reference/model_motions.py.
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/model_motions.json");
    const auto reference = nlohmann::json::parse(in)["fitzhugh_nagumo"];
    const auto system = make_system("fitzhugh_nagumo");
    const double period = std::stod(reference["period"].get<std::string>());
    const double w = std::stod(reference["w_at_v_0"].get<std::string>());
    const auto cycle = tests::closed_orbit(*system, system->default_parameters(), Eigen::Vector2d(0.0, -0.16), 39.5, 0);
    // Measured 1.5e-11 and 2.0e-13, times ten.
    CHECK_THAT(cycle.period, WithinAbs(period, 1.5e-10));
    CHECK_THAT(cycle.start[1], WithinAbs(w, 2e-12));
}

}  // namespace orbid::models::fitzhugh_nagumo_test
