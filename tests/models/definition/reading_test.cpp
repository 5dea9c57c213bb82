#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::reading_test {

using tests::WithinAbs;

namespace {
constexpr double pi = std::numbers::pi;
using Free = std::vector<Eigen::Index>;

Eigen::MatrixXd some_states(Eigen::Index count) {
    Eigen::MatrixXd states(2, count);
    for (Eigen::Index k = 0; k < count; ++k)
        states.col(k) << std::sin(1.7 * static_cast<double>(k)) * 3.0, std::cos(2.9 * static_cast<double>(k)) * 9.0;
    return states;
}
}  // namespace

TEST_CASE("the state sensor reads what the instrument of the model reads", "[models][fast]") {
    const Eigen::MatrixXd states = some_states(7);
    const std::vector<double> phases(7, 0.3);
    const auto pendulum = make_system("parametric_pendulum");
    const auto plain = pendulum->readings({}, states, phases, pendulum->default_parameters(), Free{1, 3});
    CHECK(plain.readings == states);
    REQUIRE(plain.derivatives.cols() == 7 * 4);
    for (Eigen::Index k = 0; k < 7; ++k)
        CHECK(plain.derivatives.middleCols(4 * k, 4).isIdentity(0.0));
    CHECK(pendulum->readings({}, states, phases, pendulum->default_parameters()).derivatives.size() == 0);

    const auto free_pendulum = make_system("free_pendulum");
    Eigen::VectorXd theta = free_pendulum->default_parameters();
    theta[4] = 0.25;
    const auto off = free_pendulum->readings({}, states, phases, theta, Free{0, 1, 2, 3, 4});
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(2, 7);
    expected(0, 0) = expected(1, 1) = expected(0, 6) = 1.0;
    for (Eigen::Index k = 0; k < 7; ++k) {
        CHECK(off.readings(0, k) == states(0, k) + 0.25);
        CHECK(off.readings(1, k) == states(1, k));
        CHECK(off.derivatives.middleCols(7 * k, 7) == expected);
    }
}

TEST_CASE("the difference quotient is that of the flow, with its derivatives", "[models][fast]") {
    Sensor sensor;
    sensor.type = Sensor::Type::angle_difference;
    sensor.delay = 0.01508;
    for (const char* name : {"parametric_pendulum", "free_pendulum"}) {
        CAPTURE(name);
        const auto system = make_system(name);
        Eigen::VectorXd theta = system->default_parameters();
        theta[system->parameters().size() == 9 ? 2 : 1] = 0.01;  // dry friction
        const Eigen::MatrixXd states = some_states(200);
        std::vector<double> phases;
        for (int k = 0; k < 200; ++k)
            phases.push_back(0.1 * k);
        Free free;
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            free.push_back(i);
        const auto readings = system->readings(sensor, states, phases, theta, free);
        REQUIRE(readings.status == FlowStatus::ok);
        CHECK(system->readings(sensor, states, phases, theta).readings == readings.readings);
        const Eigen::Index d = 2 + theta.size();
        double bias = 0.0;
        for (Eigen::Index k = 0; k < 200; k += 23) {
            CAPTURE(k);
            const double phase = phases[static_cast<std::size_t>(k)];
            const std::vector<double> delay{sensor.delay};
            const auto later = system->flow(states.col(k), phase, delay, theta, Clock::time);
            // The quotient divides rounding of angles of size 3 by 0.015.
            CHECK_THAT(readings.readings(1, k), WithinAbs((later.states(0, 0) - states(0, k)) / sensor.delay, 1e-12));
            bias = std::max(bias, std::abs(readings.readings(1, k) - states(1, k)));
            for (Eigen::Index j = 0; j < d; ++j) {
                const double size = j < 2 ? 1.0 : std::max(std::abs(theta[j - 2]), 0.01);
                const double h = 1e-4 * size;
                const auto at = [&](double step) -> Eigen::Vector2d {
                    Eigen::MatrixXd x = states.col(k);
                    Eigen::VectorXd p = theta;
                    if (j < 2)
                        x(j, 0) += step;
                    else
                        p[j - 2] += step;
                    return system->readings(sensor, x, std::array{phase}, p).readings.col(0);
                };
                const bool bounded = j >= 2 && theta[j - 2] < 2.0 * h && system->parameters()[j - 2].domain != any_real;
                if (bounded) continue;
                const Eigen::Vector2d difference = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h);
                const Eigen::Vector2d exact = readings.derivatives.col(k * d + j);
                CHECK((difference - exact).norm() * size < 1e-8 * (1.0 + exact.norm() * size));
            }
        }
        // Its bias against the velocity is the reason for this sensor: up to a d / 2, some tenths of rad/s.
        CHECK(bias > 0.05);
        CHECK(bias < 1.0);
    }
}

TEST_CASE("sensors that cannot be are refused", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    const auto theta = system->default_parameters();
    const Eigen::MatrixXd states = some_states(2);
    const std::vector<double> phases(2, 0.0);
    Sensor sensor;
    sensor.type = Sensor::Type::angle_difference;
    CHECK_THROWS_AS(system->readings(sensor, states, phases, theta), std::invalid_argument);  // delay 0
    sensor.delay = 0.01;
    CHECK_NOTHROW(system->readings(sensor, states, phases, theta));
    sensor.angle = 1;
    CHECK_THROWS_AS(system->readings(sensor, states, phases, theta), std::invalid_argument);
    sensor.angle = 0;
    sensor.rate = 0;
    CHECK_THROWS_AS(system->readings(sensor, states, phases, theta), std::invalid_argument);
    CHECK_THROWS_AS(system->readings({}, states, std::vector<double>(3, 0.0), theta), std::invalid_argument);
    CHECK_THROWS_AS(system->readings({}, Eigen::MatrixXd::Zero(3, 2), phases, theta), std::invalid_argument);
}

TEST_CASE("an ensemble is the repeated flow of each trajectory", "[models][fast]") {
    for (const char* name : {"parametric_pendulum", "duffing"}) {
        for (const double k1 : {0.0, 1e-3}) {
            CAPTURE(name, k1);
            const auto system = make_system(name);
            Eigen::VectorXd theta = system->default_parameters();
            if (system->parameter_index("k1") >= 0) theta[2] = k1;
            const Eigen::MatrixXd starts = some_states(3) / 3.0;
            const auto ensemble = system->ensemble(starts, 0.4, 40, theta);
            REQUIRE(ensemble.sections.size() == 3);
            const std::vector<double> period{2.0 * pi};
            double worst = 0.0;
            for (std::size_t i = 0; i < 3; ++i) {
                CHECK(ensemble.status[i] == FlowStatus::ok);
                REQUIRE(ensemble.sections[i].cols() == 41);
                CHECK(ensemble.sections[i].col(0) == starts.col(static_cast<Eigen::Index>(i)));
                for (Eigen::Index k = 0; k < 40; ++k) {
                    // Chaotic: each period by itself, from the section before.
                    const auto flow = system->flow_with_sensitivities(ensemble.sections[i].col(k), 0.4, period, theta,
                                                                      {}, Clock::phase);
                    Eigen::Vector2d image = flow.states.col(0);
                    if (system->coordinates()[0].angle) image[0] = wrapped(image[0]);
                    const double stretch = 1.0 + flow.sensitivities.norm();
                    worst = std::max(worst, (image - ensemble.sections[i].col(k + 1)).norm() / stretch);
                }
            }
            // Measured at most 3.1e-12 of the stretch (tolerance 1e-12 per step in both), times ten.
            CHECK(worst < 3.1e-11);
        }
    }
}

TEST_CASE("an ensemble has the same bytes with any number of threads", "[models][fast][threads]") {
    const auto system = make_system("parametric_pendulum");
    const Eigen::MatrixXd starts = some_states(5);
    std::vector<EnsembleResult> results;
    for (const std::size_t threads : {1, 2, 4}) {
        const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism, threads);
        results.push_back(system->ensemble(starts, 0.0, 50, system->default_parameters()));
    }
    for (const auto& other : results)
        for (std::size_t i = 0; i < 5; ++i)
            CHECK((other.sections[i].array() == results[0].sections[i].array()).all());
}

TEST_CASE("an ensemble says which trajectories could not be continued", "[models][fast]") {
    const auto system = make_system("duffing");
    Eigen::VectorXd theta = system->default_parameters();
    theta[2] = -1.0;  // beyond a hill the spring pushes outwards
    theta[1] = 1.0;
    theta[3] = 0.0;
    Eigen::MatrixXd starts(2, 2);
    starts << 0.1, 3.0, 0.0, 0.0;
    const auto ensemble = system->ensemble(starts, 0.0, 5, theta);
    CHECK(ensemble.status[0] == FlowStatus::ok);
    CHECK(ensemble.sections[0].cols() == 6);
    CHECK(ensemble.status[1] == FlowStatus::not_finite);
    CHECK(ensemble.sections[1].cols() < 6);
    CHECK(ensemble.sections[1].col(0) == starts.col(1));
    CHECK_THROWS_AS(make_system("lotka_volterra")->ensemble(starts, 0.0, 5, Eigen::Vector4d::Ones()), std::logic_error);
    CHECK_THROWS_AS(system->ensemble(Eigen::MatrixXd::Zero(3, 1), 0.0, 5, theta), std::invalid_argument);
}

}  // namespace orbid::models::reading_test
