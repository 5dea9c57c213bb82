// Measures of orbits against closed forms and an independent computation, and their estimates along a branch.
#include "periodic/waveforms/branch_residual.hpp"

#include <cmath>
#include <complex>
#include <limits>
#include <memory>

#include <fmt/format.h>

#include "estimator/estimate/estimate.hpp"
#include "models/definition/wrong_data.hpp"
#include "periodic/orbit/orbit_amplitude.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "tests/periodic/orbit/steady_state.hpp"
#include "tests/periodic/waveforms/derivative_error.hpp"

namespace branch_residual_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::VectorXd;
using periodic::BranchChannel;
using periodic::BranchOptions;
using periodic::BranchResidual;
using periodic::MeasuredOrbit;
using periodic::OrbitMeasure;
using periodic::OrbitStatus;
using periodic::StartingSolution;

namespace {

constexpr double missing = std::numeric_limits<double>::quiet_NaN();
constexpr double turn = 2.0 * std::numbers::pi;

BranchChannel channel_of(OrbitMeasure measure, Index coordinate = 0) {
    BranchChannel channel;
    channel.measure = measure;
    channel.coordinate = coordinate;
    return channel;
}

std::vector<BranchChannel> all_measures(Index coordinate) {
    std::vector<BranchChannel> channels;
    for (const OrbitMeasure measure : {OrbitMeasure::maximum, OrbitMeasure::minimum, OrbitMeasure::mean,
                                       OrbitMeasure::half_range, OrbitMeasure::rms, OrbitMeasure::frequency})
        channels.push_back(channel_of(measure, coordinate));
    return channels;
}

StartingSolution started(const VectorXd& state, double time = 0.0) {
    StartingSolution start;
    start.points = state;
    start.time = time;
    return start;
}

/// Duffing's oscillator in harmonic balance: starts at the amplitudes A with ((alpha - w^2 + 3/4 beta A^2)^2 +
/// (delta w)^2) A^2 = gamma^2.
std::vector<StartingSolution> duffing_starts(const models::System& system, const VectorXd& values) {
    const auto at = [&](const char* name) { return values(system.parameter_index(name)); };
    const double w = at("omega"), delta = at("delta"), gamma = at("gamma");
    const auto rest = [&](double a) {
        const double stiffness = at("alpha") - w * w + 0.75 * at("beta") * a * a;
        return (stiffness * stiffness + delta * delta * w * w) * a * a - gamma * gamma;
    };
    std::vector<StartingSolution> starts;
    const double step = 1e-4;
    for (double a = step; a < 10.0; a += step) {
        if (!(rest(a) * rest(a + step) < 0.0)) continue;
        const std::complex<double> wave =
            gamma / std::complex<double>(at("alpha") - w * w + 0.75 * at("beta") * a * a, delta * w);
        starts.push_back(started(Eigen::Vector2d(wave.real(), -w * wave.imag())));
    }
    return starts;
}

std::shared_ptr<const models::System> make(const char* name) {
    return models::make_system(name, "");
}

}  // namespace

TEST_CASE("measures of a linear oscillator in closed form", "[periodic][waveform]") {
    const auto system = make("duffing");
    const double delta = 0.4, alpha = 2.0, gamma = 1.3, omega = 1.7;
    const VectorXd values =
        with_values(*system, {{"delta", delta}, {"alpha", alpha}, {"beta", 0.0}, {"gamma", gamma}, {"omega", omega}});
    const auto binding = estimated(*system, values, {"omega", "delta", "gamma"});
    BranchOptions options;
    options.channels = all_measures(0);
    options.start = picked(binding);
    // A = gamma / |d|, |d|^2 = (alpha - w^2)^2 + (delta w)^2; its derivatives by w, delta, gamma.
    const double stiffness = alpha - omega * omega;
    const double d2 = stiffness * stiffness + delta * delta * omega * omega;
    const double a = gamma / std::sqrt(d2);
    const Eigen::RowVector3d slope(-a / d2 * (-2.0 * omega * stiffness + delta * delta * omega),
                                   -a / d2 * delta * omega * omega, a / gamma);
    const double factor[] = {1.0, -1.0, 0.0, 1.0, std::sqrt(0.5)};
    MeasuredOrbit orbit{"omega = 1.7", binding, VectorXd(6), {}, {started(Eigen::Vector2d(0.0, 0.0))}};
    orbit.values << a, -a, 0.0, a, std::sqrt(0.5) * a, omega / turn;
    const BranchResidual residual(system, {orbit}, options);
    REQUIRE(residual.start_status(0) == OrbitStatus::converged);
    const auto value = residual.evaluate(residual.initial_set(), options.start, {{}}, true)[0];
    REQUIRE(value.status == estimator::BlockStatus::ok);
    for (Index i = 0; i < 5; ++i) {
        CAPTURE(i);
        CHECK_THAT(value.e(i), WithinAbs(0.0, 1e-12));
        CHECK((-value.e_theta.row(i) - factor[i] * slope).cwiseAbs().maxCoeff() < 1e-11);
    }
    CHECK_THAT(value.e(5), WithinAbs(0.0, 1e-15));
    CHECK((-value.e_theta.row(5) - Eigen::RowVector3d(1.0 / turn, 0.0, 0.0)).cwiseAbs().maxCoeff() < 1e-15);
    CHECK(residual.groups()[3].name == "branch.x.half_range");
    CHECK(residual.groups()[5].name == "branch.frequency");
    CHECK(residual.groups()[5].unit == "Hz");
}

TEST_CASE("measures of formulas of a linear oscillator in closed form", "[periodic][waveform]") {
    const auto system = make("duffing");
    const double delta = 0.4, alpha = 2.0, gamma = 1.3, omega = 1.7;
    const VectorXd values =
        with_values(*system, {{"delta", delta}, {"alpha", alpha}, {"beta", 0.0}, {"gamma", gamma}, {"omega", omega}});
    const auto binding = estimated(*system, values, {"omega", "delta", "gamma"});
    const auto names = models::reading_names(system->coordinates(), system->parameters());
    BranchOptions options;
    options.start = picked(binding);
    // A force of spring and damper, which turns ahead of x; a square, of twice the frequency; three on two coordinates.
    const std::string x(system->coordinates()[0].name), v(system->coordinates()[1].name);
    options.readings = {{"force", "N", models::Expression::parse("alpha * " + x + " + delta * " + v, names)},
                        {"square", "m^2", models::Expression::parse(x + "^2", names)},
                        {"scaled", "", models::Expression::parse("gamma * " + v + " + 3", names)}};
    const Index n = system->dimension();
    for (Index i = 0; i < 3; ++i)
        options.channels.push_back(channel_of(OrbitMeasure::half_range, n + i));
    options.channels.push_back(channel_of(OrbitMeasure::mean, n + 1));
    options.channels.push_back(channel_of(OrbitMeasure::minimum, n + 2));
    options.channels.push_back(channel_of(OrbitMeasure::rms, n));
    // A = gamma / |d|, |d|^2 = (alpha - w^2)^2 + (delta w)^2; the force has the amplitude F = A |alpha + i delta w|.
    const auto amplitude = [&](double w, double c, double g) {
        return g / std::abs(std::complex<double>(alpha - w * w, c * w));
    };
    const auto predicted = [&](double w, double c, double g) {
        const double a = amplitude(w, c, g);
        const double force = a * std::abs(std::complex<double>(alpha, c * w));
        VectorXd all(6);
        all << force, 0.5 * a * a, g * w * a, 0.5 * a * a, 3.0 - g * w * a, std::sqrt(0.5) * force;
        return all;
    };
    MeasuredOrbit orbit{
        "omega = 1.7", binding, predicted(omega, delta, gamma), {}, {started(Eigen::Vector2d(0.0, 0.0))}};
    const BranchResidual residual(system, {orbit}, options);
    REQUIRE(residual.start_status(0) == OrbitStatus::converged);
    const auto value = residual.evaluate(residual.initial_set(), options.start, {{}}, true)[0];
    REQUIRE(value.status == estimator::BlockStatus::ok);
    CHECK(value.e.cwiseAbs().maxCoeff() < 1e-11);
    // Derivatives of the closed form by differences of fourth order: 1e-12, 6e-10 with five times the step.
    const double h = 2e-4;
    const auto slope = [&](int i) {
        const auto at = [&](double step) {
            return predicted(omega + (i == 0 ? step : 0.0), delta + (i == 1 ? step : 0.0),
                             gamma + (i == 2 ? step : 0.0));
        };
        return VectorXd((8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h));
    };
    for (int i = 0; i < 3; ++i) {
        CAPTURE(i);
        CHECK((-value.e_theta.col(i) - slope(i)).cwiseAbs().maxCoeff() < 1e-10);
    }
    CHECK(residual.groups()[0].name == "branch.force.half_range");
    CHECK(residual.groups()[0].unit == "N");
    CHECK(residual.quantity(residual.channels()[3]).first == "square.mean");
    CHECK(residual.quantity(residual.channels()[3]).second == "m^2");
    CHECK(derivative_error(residual, options.start, {{}}, 1e-3) < 1e-8);
    options.channels.push_back(channel_of(OrbitMeasure::rms, n + 3));
    orbit.values.conservativeResize(7);
    orbit.values(6) = 1.0;
    CHECK_THROWS_AS(BranchResidual(system, {orbit}, options), std::invalid_argument);
}

TEST_CASE("a formula of an angle that turns around is measured where a turn does not change it",
          "[periodic][waveform]") {
    // The parametric pendulum, locked: one turn per period of the crank.
    const auto system = models::make_system("parametric_pendulum", "harmonic");
    const VectorXd values = with_values(*system, {{"omega", 13.0}});
    StartingSolution start = started(Eigen::Vector2d(0.0, 13.0));
    start.rotation = {1};
    periodic::ShootingOptions solver;
    solver.maximum_distance = 100.0;
    const auto orbit = periodic::solve_orbit(*system, values, start, {}, solver);
    REQUIRE(orbit.status == OrbitStatus::converged);
    const auto names = models::reading_names(system->coordinates(), system->parameters());
    const std::vector<periodic::OrbitReading> readings{
        {"across", "m", models::Expression::parse("l * sin(phi)", names)},
        {"unwound", "rad", models::Expression::parse("0.1 * phi", names)}};
    const periodic::OrbitReadings along(*system, values, orbit, {}, std::nullopt, models::FlowOptions{}, readings);
    REQUIRE(along.simulated());
    CHECK_FALSE(along.measure(OrbitMeasure::half_range, 0));
    // Over a whole turn the sine takes all its values.
    const auto across = along.measure(OrbitMeasure::half_range, 2);
    REQUIRE(across);
    CHECK_THAT(across->value, WithinAbs(values(system->parameter_index("l")), 1e-8));
    CHECK_FALSE(along.measure(OrbitMeasure::half_range, 3));
}

TEST_CASE("measures of limit cycles agree with those of orbits, their derivatives with differences",
          "[periodic][waveform]") {
    const auto system = make("van_der_pol");
    const auto binding = estimated(*system, with_values(*system, {{"mu", 1.5}}), {"mu"});
    BranchOptions options;
    options.start = picked(binding);
    const StartingSolution start = started(Eigen::Vector2d(2.0, 0.0), 7.0);
    for (const Index coordinate : {Index{0}, Index{1}}) {
        options.channels = all_measures(coordinate);
        VectorXd about(6);
        about << 2.0, -2.0, 0.0, 2.0, 1.4, 0.14;
        if (coordinate == 1) about << 3.3, -3.3, 0.0, 3.3, 1.5, 0.14;
        const BranchResidual residual(system, {{"mu = 1.5", binding, about, {}, {start}}}, options);
        REQUIRE(residual.start_status(0) == OrbitStatus::converged);
        const auto value = residual.evaluate(residual.initial_set(), options.start, {{}}, false)[0];
        const VectorXd predicted = about - value.e;
        const auto orbit = residual.solutions(residual.initial_set(), options.start)[0];
        const auto amplitude = periodic::amplitude_of(*system, binding.base, 0.0, orbit, options.flow);
        // Measured: 4e-11 of the extrema, which the other computation locates by a parabola; 3e-13 of the means.
        CHECK_THAT(predicted(0), WithinAbs(amplitude.maximum(coordinate), 1e-9));
        CHECK_THAT(predicted(1), WithinAbs(amplitude.minimum(coordinate), 1e-9));
        CHECK_THAT(predicted(2), WithinAbs(amplitude.mean(coordinate), 1e-11));
        CHECK_THAT(predicted(3), WithinAbs(amplitude.half_range(coordinate), 1e-9));
        CHECK_THAT(predicted(4), WithinAbs(amplitude.rms(coordinate), 1e-11));
        CHECK_THAT(predicted(5), WithinAbs(1.0 / orbit.time, 1e-14));
        CHECK(derivative_error(residual, options.start, {{}}, 1e-2) < 1e-8);
    }
}

TEST_CASE("a branch around its folds, stable and unstable, gives the parameters back", "[periodic][waveform]") {
    const auto system = make("duffing");
    const VectorXd truth =
        with_values(*system, {{"delta", 0.1}, {"alpha", 1.0}, {"beta", 0.3}, {"gamma", 0.4}, {"omega", 1.3}});
    std::vector<MeasuredOrbit> orbits;
    BranchOptions options;
    options.channels = {channel_of(OrbitMeasure::half_range), channel_of(OrbitMeasure::rms, 1)};
    VectorXd start(3);
    for (const double omega : {1.35, 1.4, 1.45}) {
        VectorXd values = truth;
        values(system->parameter_index("omega")) = omega;
        auto binding = estimated(*system, values, {"delta", "beta", "gamma"});
        start = picked(binding).cwiseProduct(Eigen::Vector3d(1.05, 0.96, 1.03));
        const auto starts = duffing_starts(*system, values);
        REQUIRE(starts.size() == 3);
        for (std::size_t i = 0; i < starts.size(); ++i) {
            const auto solved = periodic::solve_orbit(*system, values, starts[i], {}, {});
            REQUIRE(solved.status == OrbitStatus::converged);
            CHECK((std::abs(solved.multipliers[0]) > 1.0) == (i == 1));
            const auto amplitude = periodic::amplitude_of(*system, values, 0.0, solved, options.flow);
            MeasuredOrbit orbit;
            orbit.label = fmt::format("omega = {}, {}", omega, i);
            orbit.binding = binding;
            orbit.values = Eigen::Vector2d(amplitude.half_range(0), amplitude.rms(1));
            orbit.starts = starts;  // the measures tell which one it is
            orbits.push_back(std::move(orbit));
        }
    }
    orbits[4].values(1) = missing;
    options.start = start;
    const BranchResidual residual(system, orbits, options);
    CHECK(residual.sources(4) == std::vector<std::size_t>{0});
    std::vector<estimator::FreeParameter> parameters(3);
    const char* names[] = {"delta", "beta", "gamma"};
    for (Index i = 0; i < 3; ++i) {
        parameters[static_cast<std::size_t>(i)].name = names[i];
        parameters[static_cast<std::size_t>(i)].start = start(i);
    }
    const estimator::Estimate estimate = estimator::estimate(parameters, {&residual});
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    const VectorXd found = estimate.parameters.size() == 3
                               ? VectorXd(Eigen::Vector3d(estimate.parameters[0].value, estimate.parameters[1].value,
                                                          estimate.parameters[2].value))
                               : VectorXd::Zero(3);
    CHECK((found - Eigen::Vector3d(0.1, 0.3, 0.4)).cwiseAbs().maxCoeff() < 1e-9);
    for (const auto& block : estimate.active[0].layout)
        CHECK(block.active);
}

TEST_CASE("senseless branches are refused", "[periodic][waveform]") {
    const auto system = make("van_der_pol");
    const auto binding = estimated(*system, system->default_parameters(), {"mu"});
    const MeasuredOrbit good{"one", binding, VectorXd::Ones(1), {}, {started(Eigen::Vector2d(2.0, 0.0), 7.0)}};
    const auto refused = [&](auto change, const std::string& rule) {
        MeasuredOrbit orbit = good;
        BranchOptions options;
        options.channels = {channel_of(OrbitMeasure::maximum)};
        options.start = picked(binding);
        change(orbit, options);
        CHECK_THROWS_WITH(BranchResidual(system, {orbit}, options), ContainsSubstring(rule));
    };
    refused([](auto&, auto& options) { options.channels.clear(); }, "at least one channel");
    refused([](auto&, auto& options) { options.channels.push_back(options.channels[0]); },
            "max of coordinate 0 is measured by two channels");
    refused([](auto&, auto& options) { options.channels[0].coordinate = 2; }, "channel of coordinate 2");
    refused([](auto&, auto& options) { options.channels[0].distribution = estimator::AutoregressiveErrors{}; },
            "no course in time");
    refused([](auto& orbit, auto&) { orbit.values(0) = missing; }, "one: nothing is measured");
    refused([](auto& orbit, auto&) { orbit.values.resize(2); }, "one: 2 values, must be 1");
    refused([](auto&, auto& options) { options.channels[0].known_sds = true; }, "max has no known sd > 0");
    refused(
        [](auto& orbit, auto& options) {
            orbit.values(0) = -1.0;
            options.channels[0].distribution = estimator::LogNormalErrors{};
        },
        "log-normal errors of -1");
}

}  // namespace branch_residual_test
