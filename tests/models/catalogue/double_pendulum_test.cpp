#include "models/catalogue/double_pendulum.hpp"

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/real_arms.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::double_pendulum_test {

static_assert(InstrumentModel<ViscousJoints> && ReducedModel<ViscousJoints> && SymmetricModel<ViscousJoints>);

using tests::Arms;
using tests::WithinAbs;
using tests::WithinRel;

namespace {
constexpr double pi = std::numbers::pi;
}

TEST_CASE("a double pendulum moves as in Hamilton's form", "[models][reference]") {
    // Extrapolation of Hamilton's equations in 40 digits: tests/reference/model_motions.py.
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/model_motions.json");
    const auto reference = nlohmann::json::parse(in)["double_pendulum"];
    const auto system = make_system("double_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    for (const auto& [name, value] : reference["parameters"].items())
        CHECK(theta[system->parameter_index(name)] == std::stod(value.get<std::string>()));
    const auto flow = system->flow_with_sensitivities(Eigen::Vector4d(2.0, -1.0, 1.0, -2.0), 0.0, std::array{2.0},
                                                      theta, {}, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    Eigen::Vector4d expected;
    for (int i = 0; i < 4; ++i)
        expected[i] = std::stod(reference["state"][static_cast<std::size_t>(i)].get<std::string>());
    // Chaotic: errors are stretched by the derivatives. Measured 5.2e-10, times ten.
    CHECK((flow.states.col(0) - expected).norm() < 5.2e-9);
}

TEST_CASE("a double pendulum keeps its energy without friction and loses it at the joints", "[models][fast]") {
    const auto system = make_system("double_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    const Arms arms(theta);
    const Eigen::Vector4d start(2.5, -2.0, 3.0, -5.0);
    const double scale = arms.G1 + arms.G2;
    std::vector<double> durations;
    for (int i = 1; i <= 20; ++i)
        durations.push_back(i);
    theta[7] = theta[8] = 0.0;
    const auto free = system->flow(start, 0.0, durations, theta, Clock::time);
    for (Eigen::Index k = 0; k < 20; ++k)
        // Measured at most 5.4e-11 of the scale, times twenty.
        CHECK_THAT(arms.energy(free.states.col(k)), WithinAbs(arms.energy(start), 1e-9 * scale));
    // E' = -k1 phi1'^2 - k2 (phi2' - phi1')^2, from the equations in any state.
    theta[7] = 2e-3;
    theta[8] = 5e-3;
    for (int i = 0; i < 5; ++i) {
        const Eigen::Vector4d x(1.1 * i, 2.0 - 0.7 * i, 3.0 - i, -4.0 + 2.0 * i);
        const Eigen::Vector4d f = system->rhs(x, std::array{0.0}, theta);
        const double d = x[0] - x[1];
        const double power =
            arms.J1 * x[2] * f[2] + arms.J2 * x[3] * f[3] +
            arms.h * (std::cos(d) * (x[2] * f[3] + x[3] * f[2]) - std::sin(d) * (x[2] - x[3]) * x[2] * x[3]) +
            arms.G1 * std::sin(x[0]) * x[2] + arms.G2 * std::sin(x[1]) * x[3];
        const double friction = theta[7] * x[2] * x[2] + theta[8] * (x[3] - x[2]) * (x[3] - x[2]);
        CHECK_THAT(power, WithinAbs(-friction, 1e-13));
    }
}

TEST_CASE("small swings of a double pendulum have their two frequencies", "[models][reference]") {
    // det(G - omega^2 M) = 0 with M = [J1 h; h J2], G = diag(G1, G2): a quadratic in omega^2.
    const auto system = make_system("double_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[7] = theta[8] = 0.0;
    const Arms arms(theta);
    const double A = arms.J1 * arms.J2 - arms.h * arms.h, B = arms.J1 * arms.G2 + arms.J2 * arms.G1,
                 C = arms.G1 * arms.G2;
    for (const double sign : {1.0, -1.0}) {
        const double omega = std::sqrt((B + sign * std::sqrt(B * B - 4.0 * A * C)) / (2.0 * A));
        // Mode: (G1 - omega^2 J1) u1 = omega^2 h u2.
        Eigen::Vector4d mode(omega * omega * arms.h, arms.G1 - omega * omega * arms.J1, 0.0, 0.0);
        mode.normalize();
        const auto after = [&](double t) -> Eigen::Vector4d {
            return system->flow_with_sensitivities(Eigen::Vector4d::Zero(), 0.0, std::array{t}, theta, {}, Clock::time)
                       .sensitivities *
                   mode;
        };
        const Eigen::Vector4d later = after(1.0), turned = after(2.0 * pi / omega);
        Eigen::Vector4d expected = std::cos(omega) * mode;
        expected.tail(2) = -omega * std::sin(omega) * mode.head(2);
        // A hundred steps with a local error of 1e-11 of a column of size ten.
        CHECK((later - expected).norm() < 1e-9);
        CHECK((turned - mode).norm() < 1e-9);
    }
    CHECK(system->at_rest(Eigen::Vector4d::Zero(), theta));
    CHECK_FALSE(system->at_rest(Eigen::Vector4d(0.1, 0.0, 0.0, 0.0), theta));
}

TEST_CASE("encoders of a double pendulum are off by their offsets", "[models][fast]") {
    const auto system = make_system("double_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[10] = pi;
    theta[11] = -0.02;
    const auto readings = system->readings({}, Eigen::Vector4d(0.1, 0.2, 3.0, 4.0), std::array{0.0}, theta);
    CHECK(readings.readings == Eigen::Vector4d(0.1 + pi, 0.2 - 0.02, 3.0, 4.0));
}

TEST_CASE("a real double pendulum moves as its published parameters say", "[models][reference]") {
    // tests/reference/double_pendulum: a chaotic, a large and a small motion. Only the state at the start is fitted.
    const auto segments = tests::real_arms();
    const auto system = make_system("double_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    // What is left (7.8, 2.9 and 4.2 mrad of motions of several rad) is the drag of the air and dry friction:
    // double_pendulum_friction_test.cpp.
    const std::map<int, double> measured{{0, 7.8e-3}, {8, 2.9e-3}, {20, 4.2e-3}};
    for (const auto& [segment, rms] : measured) {
        CAPTURE(segment);
        CHECK(tests::rms_of_angles(*system, theta, pi, segments.at(segment)) < 1.1 * rms);
    }
    // The data can tell: gravity off by 5 % leaves several times as much.
    theta[9] *= 0.95;
    for (const auto& [segment, rms] : measured) {
        CAPTURE(segment);
        CHECK(tests::rms_of_angles(*system, theta, pi, segments.at(segment)) > 3.0 * rms);
    }
}

}  // namespace orbid::models::double_pendulum_test
