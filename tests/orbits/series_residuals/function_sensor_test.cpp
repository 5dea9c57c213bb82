// Series read through formulas of the state: simulated, inverted for a start, predicted with derivatives, fitted.

#include <array>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/simulation/initial_state.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace function_sensor_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double pi = std::numbers::pi;

models::Sensor function_sensor(const models::System& system,
                               const std::vector<std::pair<std::size_t, std::string>>& formulas) {
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::function;
    const auto names = models::reading_names(system.coordinates(), system.parameters());
    for (const auto& [coordinate, text] : formulas)
        sensor.functions.push_back({coordinate, models::Expression::parse(text, names)});
    return sensor;
}

models::ParameterBinding binding(const models::System& system, const std::vector<std::string>& names) {
    models::ParameterBinding b;
    b.base = system.default_parameters();
    for (const std::string& name : names) {
        b.parameter.push_back(system.parameter_index(name));
        b.estimated.push_back(b.estimated_count++);
    }
    return b;
}

/// A free pendulum that swings over the top several times before it is caught.
VirtualExperimentOptions turning(const models::Sensor& sensor) {
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.01, 201, 0};
    options.initial.resize(2, 1);
    options.initial << 0.4, 25.0;
    options.sensor = sensor;
    return options;
}

}  // namespace

TEST_CASE("a simulated reading is the formula of the state, not wrapped", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    const auto theta = system->default_parameters();
    const auto plain = simulate(*system, theta, turning({})).series;
    const auto read = simulate(*system, theta, turning(function_sensor(*system, {{0, "phi + 0.01 * phi^2"}}))).series;
    REQUIRE(plain.segments[0].values.row(0).maxCoeff() > 4.0 * pi);
    for (Eigen::Index k = 0; k < plain.segments[0].values.cols(); ++k) {
        const double phi = plain.segments[0].values(0, k) - theta[4];
        CHECK_THAT(read.segments[0].values(0, k), WithinRel(phi + 0.01 * phi * phi, 1e-14));
    }
    CHECK((read.segments[0].values.row(1).array() == plain.segments[0].values.row(1).array()).all());
    CHECK(plain.coordinates[0].angle);
    CHECK_FALSE(read.coordinates[0].angle);
}

TEST_CASE("the state sensor reads an angle through an encoder", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    const double step = 2.0 * pi / 1000.0;
    models::Sensor sensor;
    sensor.step = step;
    sensor.rounding = models::Sensor::Rounding::nearest;
    const auto plain = simulate(*system, system->default_parameters(), turning({})).series.segments[0].values;
    const auto read = simulate(*system, system->default_parameters(), turning(sensor)).series.segments[0].values;
    for (Eigen::Index k = 0; k < read.cols(); ++k)
        CHECK_THAT(read(0, k), WithinAbs(step * std::round(plain(0, k) / step), 1e-12));
    CHECK((read.row(1).array() == plain.row(1).array()).all());
}

TEST_CASE("a formula without a value in a state that is reached ends the experiment", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    const auto run =
        simulate(*system, system->default_parameters(), turning(function_sensor(*system, {{1, "log(phi_dot - 24)"}})));
    CHECK_FALSE(run.complete);
    CHECK_THAT(run.message, ContainsSubstring("segment 0 cannot be read"));
}

TEST_CASE("states are found from readings by formulas", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    const auto theta = system->default_parameters();
    const auto start = [&](const std::vector<std::pair<std::size_t, std::string>>& formulas,
                           const std::vector<Eigen::Index>& observed) {
        const auto sensor = function_sensor(*system, formulas);
        const auto series = simulate(*system, theta, turning(sensor)).series;
        Segment known = series.segments[0];
        known.values = Eigen::MatrixXd(known.values(observed, Eigen::all));
        return initial_state(*system, theta, {known, observed, sensor, 0.0});
    };
    const Eigen::Vector2d truth(0.4, 25.0);
    // Both read: the formulas are inverted.
    CHECK((start({{0, "phi + 0.01 * phi^2"}, {1, "phi_dot * exp(0.1 * phi)"}}, {0, 1}) - truth).norm() < 1e-9);
    // The rate is unread: from the slope, whose local polynomial is good to a share of 1e-3 here.
    CHECK((start({{0, "phi + 0.01 * phi^2"}}, {0}) - truth).norm() < 0.025);
    // The formula reads what is unread too.
    CHECK((start({{0, "phi + 0.01 * phi_dot"}}, {0}) - truth).norm() < 0.1);
    // It has no value at the reading taken as a state: log(phi) < 0.
    CHECK_THAT(start({{0, "log(phi)"}}, {0})[0], WithinAbs(0.4, 1e-9));
}

TEST_CASE("series read by formulas are predicted with exact derivatives, over whole turns", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    SeriesResidualOptions options;
    options.sensor = function_sensor(*system, {{0, "phi + 0.01 * phi^2 + c2 * phi_dot"}, {1, "sin(phi) * phi_dot"}});
    const auto series = simulate(*system, system->default_parameters(), turning(options.sensor)).series;
    const SeriesResidual residual(system, binding(*system, {"w0sq", "c2"}), series, options);
    Eigen::VectorXd theta(2);
    theta << 30.0, 0.05;
    std::vector<Eigen::VectorXd> z{Eigen::Vector2d(0.4, 25.0)};
    // The reading of the angle runs through several turns and is compared as it is. Both flows have the tolerance 1e-12
    // per step; 1e-9 is what is left after two seconds.
    CHECK(residual.evaluate(residual.initial_set(), theta, z, false)[0].e.cwiseAbs().maxCoeff() < 1e-9);

    theta[1] = 0.06;
    const auto at = [&](Eigen::Index j, double h) {
        Eigen::VectorXd moved = theta;
        std::vector<Eigen::VectorXd> from = z;
        if (j < 2)
            moved[j] += h;
        else
            from[0][j - 2] += h;
        return residual.evaluate(residual.initial_set(), moved, from, false)[0].e;
    };
    const auto exact = residual.evaluate(residual.initial_set(), theta, z, true)[0];
    for (Eigen::Index j = 0; j < 4; ++j) {
        const double h = std::array{3e-3, 1e-5, 1e-4, 1e-3}[static_cast<std::size_t>(j)];
        const Eigen::VectorXd difference = (8.0 * (at(j, h) - at(j, -h)) - (at(j, 2 * h) - at(j, -2 * h))) / (12.0 * h);
        const Eigen::VectorXd column = j < 2 ? exact.e_theta.col(j) : exact.e_z.col(j - 2);
        CAPTURE(j, column.cwiseAbs().maxCoeff());
        CHECK((difference - column).cwiseAbs().maxCoeff() < 1e-6 * column.cwiseAbs().maxCoeff());
    }
}

TEST_CASE("readings by formulas may have errors relative to their size", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    SeriesResidualOptions options;
    options.forms = {{estimator::LogNormalErrors{}, 0.0, false}};
    options.observe = {"phi"};
    const auto plain = simulate(*system, system->default_parameters(), turning({})).series;
    CHECK_THROWS_WITH(SeriesResidual(system, binding(*system, {}), plain, options),
                      ContainsSubstring("an angle has no size"));
    options.sensor = function_sensor(*system, {{0, "2 - cos(phi)"}});
    const auto read = simulate(*system, system->default_parameters(), turning(options.sensor)).series;
    CHECK_NOTHROW(SeriesResidual(system, binding(*system, {}), read, options));
}

}  // namespace function_sensor_test
