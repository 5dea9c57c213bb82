#include <array>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "models/system/derivative_check.hpp"
#include "tests/catch.hpp"

namespace orbid::models::free_pendulum_test {

using tests::WithinAbs;

namespace {
constexpr double pi = std::numbers::pi;
}

TEST_CASE("a free pendulum is back after its exact period", "[models][reference]") {
    // T w0 / (2 pi) = 1 / agm(1, cos(amplitude / 2)); 60 decimal digits, rounded to 17.
    struct Row {
        double amplitude_deg, period_ratio;
    };
    const std::vector<Row> rows{{10.0, 1.0019071881432167},
                                {45.0, 1.0399733431968038},
                                {90.0, 1.1803405990160962},
                                {135.0, 1.5279475882343913},
                                {170.0, 2.4393627196738841}};
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta(5);
    theta << 19.62, 0.0, 0.0, 0.0, 0.0;
    double worst_angle = 0.0, worst_rate = 0.0;
    for (const Row& row : rows) {
        const double start = row.amplitude_deg * pi / 180.0;
        const std::vector<double> period{row.period_ratio * 2.0 * pi / std::sqrt(19.62)};
        const auto flow = system->flow(Eigen::Vector2d(start, 0.0), 0.0, period, theta, Clock::time);
        CHECK(flow.crossings >= 1);
        worst_angle = std::max(worst_angle, std::abs(flow.states(0, 0) - start));
        worst_rate = std::max(worst_rate, std::abs(flow.states(1, 0)));
    }
    // Measured 8.1e-12 rad and 7.2e-11 rad/s (170 deg), times ten.
    CHECK(worst_angle < 8.1e-11);
    CHECK(worst_rate < 7.2e-10);
}

TEST_CASE("a free pendulum with dry friction comes to rest and stays", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[1] = 0.3;
    const auto flow = system->flow(Eigen::Vector2d(1.0, 0.0), 0.0, std::vector{1e4}, theta, Clock::time);
    CHECK(flow.status == FlowStatus::ok);
    CHECK(flow.stickings == 1);
    CHECK(flow.states(1, 0) == 0.0);
    CHECK(std::abs(std::sin(flow.states(0, 0))) < 0.3 / 30.0);
    CHECK(system->at_rest(flow.states.col(0), theta));
    CHECK_FALSE(system->smooth(theta));
    CHECK(system->smooth(system->default_parameters()));
}

TEST_CASE("without its further terms the extended free pendulum is the quadratic one", "[models][fast]") {
    const auto plain = make_system("free_pendulum"), extended = make_system("free_pendulum", "extended");
    CHECK(plain->variant() == "quadratic");
    Eigen::VectorXd p = plain->default_parameters(), q = extended->default_parameters();
    REQUIRE(p.size() == 5);
    REQUIRE(q.size() == 14);
    CHECK(q.head(5) == p);
    CHECK(extended->smooth(q));
    q[1] = p[1] = 0.1;
    q[3] = p[3] = 0.02;
    const Eigen::Vector2d start(1.2, 0.0);
    const auto a = plain->flow_with_sensitivities(start, 0.0, std::array{5.0}, p, {}, Clock::time);
    const auto b = extended->flow_with_sensitivities(start, 0.0, std::array{5.0}, q, {}, Clock::time);
    CHECK(a.states == b.states);
    CHECK(a.sensitivities == b.sensitivities);
}

TEST_CASE("every law of friction of the free pendulum has its torque", "[models][reference]") {
    const auto system = make_system("free_pendulum", "extended");
    Eigen::VectorXd zero = system->default_parameters();
    zero[system->parameter_index("c2")] = 0.0;
    struct Law {
        const char* name;
        double (*torque)(double phi, double v);  ///< at coefficient 1, for v > 0
    };
    const std::array<Law, 7> laws{{
        {"c1", [](double, double) { return 1.0; }},
        {"c2", [](double, double v) { return v; }},
        {"c3", [](double, double v) { return v * v; }},
        {"c5", [](double, double v) { return v * v * v; }},
        {"c_load", [](double phi, double v) { return std::abs(std::cos(phi) + v * v / 30.0); }},
        {"c_angle", [](double phi, double) { return 1.0 - std::cos(phi); }},
        {"c_slow", [](double, double v) { return std::exp(-v * v / 0.09); }},
    }};
    for (const Law& law : laws) {
        Eigen::VectorXd theta = zero;
        theta[system->parameter_index(law.name)] = 0.7;
        for (const double phi : {-1.5, 0.3, 2.8})
            for (const double v : {0.1, 0.5, 4.0})
                for (const double sign : {1.0, -1.0}) {
                    CAPTURE(law.name, phi, v, sign);
                    const Eigen::Vector2d f = system->rhs(Eigen::Vector2d(phi, sign * v), std::array{0.0}, theta);
                    CHECK_THAT(f[1] + 30.0 * std::sin(phi), WithinAbs(-sign * 0.7 * law.torque(phi, v), 1e-13));
                }
    }
    // The power: below 0.05 rad/s linear, above v^p; at v = 4 the difference is (p - 1) / 2 (0.05 / 4)^2 of it.
    Eigen::VectorXd theta = zero;
    theta[system->parameter_index("cp")] = 0.01;
    theta[system->parameter_index("p")] = 2.4;
    const auto braking = [&](double v) { return -system->rhs(Eigen::Vector2d(0.0, v), std::array{0.0}, theta)(1, 0); };
    CHECK_THAT(braking(4.0), tests::WithinRel(0.01 * std::pow(4.0, 2.4) * (1.0 + 0.7 * std::pow(0.05 / 4.0, 2)), 1e-7));
    CHECK_THAT(braking(-4.0), WithinAbs(-braking(4.0), 1e-16));
    CHECK_THAT(braking(1e-6), tests::WithinRel(0.01 * 1e-6 * std::pow(0.05, 1.4), 1e-6));
}

TEST_CASE("derivatives of the extended free pendulum are those of its flow", "[models][fast]") {
    const auto system = make_system("free_pendulum", "extended");
    Eigen::VectorXd theta = system->default_parameters();
    theta << 30.0, 0.1, 0.03, 0.01, 0.0, 1e-3, 0.01, 2.4, 0.05, 0.04, 0.06, 0.5, 2e-3, -1e-3;
    CHECK_FALSE(system->smooth(theta));
    const std::array<Eigen::Index, 11> free{0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11};
    const auto check =
        check_derivatives(*system, Eigen::Vector2d(1.4, 0.5), 0.0, std::array{1.5}, theta, free, Clock::time);
    INFO(check.message);
    CHECK(check.passed);
    CHECK(check.compared >= 24);
}

TEST_CASE("an eccentric encoder of the free pendulum errs by the first harmonic", "[models][fast]") {
    const auto system = make_system("free_pendulum", "extended");
    Eigen::VectorXd theta = system->default_parameters();
    theta[4] = 0.02;
    theta[12] = 3e-3;
    theta[13] = -2e-3;
    const auto read = [&](double phi) -> Eigen::Vector2d {
        return system->readings({}, Eigen::Vector2d(phi, 2.0), std::array{0.0}, theta).readings.col(0);
    };
    CHECK_THAT(read(0.9)[0], WithinAbs(0.92 + 3e-3 * (std::cos(0.9) - 1.0) - 2e-3 * std::sin(0.9), 1e-15));
    CHECK(read(0.0)[0] == 0.02);
    // Central differences of the reading at 2 rad/s.
    CHECK_THAT(read(0.9)[1], WithinAbs((read(0.9 + 2e-5)[0] - read(0.9 - 2e-5)[0]) / 2e-5, 1e-9));
}

}  // namespace orbid::models::free_pendulum_test
