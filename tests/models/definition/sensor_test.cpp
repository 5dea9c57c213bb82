// Sensors that read formulas of the state, and encoders: values and derivatives against closed forms.

#include "models/definition/sensor.hpp"

#include <oneapi/tbb/global_control.h>

#include <array>
#include <cmath>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::sensor_test {

using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

using Free = std::vector<Eigen::Index>;

Sensor function_sensor(const System& system, const std::vector<std::pair<std::size_t, std::string>>& formulas) {
    Sensor sensor;
    sensor.type = Sensor::Type::function;
    const auto names = reading_names(system.coordinates(), system.parameters());
    for (const auto& [coordinate, text] : formulas)
        sensor.functions.push_back({coordinate, Expression::parse(text, names)});
    return sensor;
}

}  // namespace

TEST_CASE("a formula reads the state, other coordinates are read by the instrument", "[models][fast]") {
    // The instrument of the free pendulum adds its offset to the angle; a formula replaces it altogether.
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[4] = 0.25;
    Eigen::MatrixXd states(2, 3);
    states << 0.5, -2.0, 7.0, 3.0, 0.0, -1.5;
    const std::vector<double> phases(3, 0.0);

    const auto rate = function_sensor(*system, {{1, "2 * phi_dot + 0.1 * phi^2"}});
    const auto with_rate = system->readings(rate, states, phases, theta);
    const auto angle = function_sensor(*system, {{0, "phi + 0.01 * phi^2"}});
    const auto with_angle = system->readings(angle, states, phases, theta);
    REQUIRE(with_rate.status == FlowStatus::ok);
    REQUIRE(with_angle.status == FlowStatus::ok);
    for (Eigen::Index k = 0; k < 3; ++k) {
        const double phi = states(0, k), phi_dot = states(1, k);
        CHECK(with_rate.readings(0, k) == phi + 0.25);
        CHECK_THAT(with_rate.readings(1, k), WithinRel(2.0 * phi_dot + 0.1 * phi * phi, 1e-15));
        CHECK_THAT(with_angle.readings(0, k), WithinRel(phi + 0.01 * phi * phi, 1e-15));
        CHECK(with_angle.readings(1, k) == phi_dot);
    }
    CHECK(with_rate.derivatives.size() == 0);
}

TEST_CASE("derivatives of formulas are exact in state and free parameters", "[models][fast]") {
    const auto system = make_system("lotka_volterra");
    // Six names, more than one chunk of directions; delta is held.
    const auto sensor = function_sensor(*system, {{0, "u * v^2 + sin(alpha * u) - beta / gamma + exp(delta) * v"}});
    const Free free{system->parameter_index("gamma"), system->parameter_index("alpha"),
                    system->parameter_index("beta")};
    Eigen::VectorXd theta(4);
    theta[system->parameter_index("alpha")] = 0.7;
    theta[system->parameter_index("beta")] = 0.3;
    theta[system->parameter_index("gamma")] = 0.9;
    theta[system->parameter_index("delta")] = 0.2;
    const Eigen::Index count = 5000;  // several tasks
    Eigen::MatrixXd states(2, count);
    for (Eigen::Index k = 0; k < count; ++k)
        states.col(k) << 1.0 + 0.001 * static_cast<double>(k), 3.0 - 0.0005 * static_cast<double>(k);
    const std::vector<double> phases(static_cast<std::size_t>(count), 0.0);
    const auto result = system->readings(sensor, states, phases, theta, free);
    REQUIRE(result.status == FlowStatus::ok);
    CHECK(system->readings(sensor, states, phases, theta).readings == result.readings);
    REQUIRE(result.derivatives.cols() == 5 * count);
    double worst = 0.0;
    for (Eigen::Index k = 0; k < count; ++k) {
        const double u = states(0, k), v = states(1, k);
        Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(2, 5);
        expected.row(0) << v * v + 0.7 * std::cos(0.7 * u), 2.0 * u * v + std::exp(0.2), 0.3 / 0.81,
            u * std::cos(0.7 * u), -1.0 / 0.9;
        expected(1, 1) = 1.0;
        worst = std::max(worst, (result.derivatives.middleCols(5 * k, 5) - expected).cwiseAbs().maxCoeff());
    }
    CHECK(worst < 1e-13);  // entries up to 40, a few roundings each

    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    const auto alone = system->readings(sensor, states, phases, theta, free);
    CHECK((alone.readings.array() == result.readings.array()).all());
    CHECK((alone.derivatives.array() == result.derivatives.array()).all());
}

TEST_CASE("a formula without a finite value is no reading", "[models][fast]") {
    const auto system = make_system("lotka_volterra");
    const auto sensor = function_sensor(*system, {{1, "log(v)"}});
    Eigen::MatrixXd states(2, 2);
    states << 1.0, 1.0, 2.0, -1.0;
    const auto theta = system->default_parameters();
    CHECK(system->readings(sensor, states, std::vector<double>(2, 0.0), theta).status == FlowStatus::not_finite);
    CHECK(system->readings(sensor, states.leftCols(1), std::vector<double>(1, 0.0), theta).status == FlowStatus::ok);
}

TEST_CASE("formulas in the place of angles are no angles", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    const auto coordinates = system->coordinates();
    const auto sensor = function_sensor(*system, {{0, "sin(phi)"}});
    CHECK(reads_angle({}, coordinates, 0));
    CHECK_FALSE(reads_angle({}, coordinates, 1));
    CHECK_FALSE(reads_angle(sensor, coordinates, 0));
    CHECK(reading_function(sensor, 0) == &sensor.functions[0].expression);
    CHECK(reading_function(sensor, 1) == nullptr);
    const auto rate = function_sensor(*system, {{1, "phi"}});
    CHECK(reads_angle(rate, coordinates, 0));
    CHECK_FALSE(reads_angle(rate, coordinates, 1));
}

TEST_CASE("sensors of formulas and encoders that cannot be are refused", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    const auto refused = [&](const Sensor& sensor, const std::string& rule) {
        CAPTURE(rule);
        CHECK_THROWS_WITH(
            system->readings(sensor, Eigen::MatrixXd::Zero(2, 1), std::array{0.0}, system->default_parameters()),
            ContainsSubstring(rule));
    };
    refused(function_sensor(*system, {}), "has no formula");
    refused(function_sensor(*system, {{2, "phi"}}), "in the place of coordinate 2, there are 2");
    refused(function_sensor(*system, {{0, "phi"}, {0, "phi_dot"}}), "coordinate phi has two formulas");
    const auto other = make_system("parametric_pendulum");
    refused(function_sensor(*other, {{0, "epsilon"}}), "uses name 10, there are 7");
    Sensor empty;
    empty.type = Sensor::Type::function;
    empty.functions.resize(1);
    refused(empty, "formula 0 is empty");
    Sensor encoder;
    encoder.step = -1.0;
    refused(encoder, "step of the encoder is -1");
    encoder.step = 0.1;
    encoder.angle = 1;
    refused(encoder, "coordinate 1 is not an angle");
    encoder.angle = 0;
    CHECK_NOTHROW(
        system->readings(encoder, Eigen::MatrixXd::Zero(2, 1), std::array{0.0}, system->default_parameters()));
}

}  // namespace orbid::models::sensor_test
