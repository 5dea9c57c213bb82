// Values and derivatives of waveform residuals: closed form, and differences of the residual itself.

#include <cmath>
#include <complex>
#include <memory>

#include "periodic/waveforms/waveform_residual.hpp"
#include "tests/periodic/orbit/steady_state.hpp"
#include "tests/periodic/waveforms/derivative_error.hpp"

namespace waveform_derivatives_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::WaveformOptions;
using periodic::WaveformRecord;
using periodic::WaveformResidual;

namespace {

constexpr double pi = std::numbers::pi;

}  // namespace

TEST_CASE("waveform of a linear oscillator in closed form", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const double delta = 0.4, alpha = 2.0, gamma = 1.3, omega = 1.7, phase = 0.9;
    const VectorXd values =
        with_values(*system, {{"delta", delta}, {"alpha", alpha}, {"beta", 0.0}, {"gamma", gamma}, {"omega", omega}});
    const auto binding = estimated(*system, values, {"omega", "delta", "gamma", "alpha"});
    // Three periods and a bit, not commensurate with the forcing, not beginning at time 0.
    const VectorXd times = VectorXd::LinSpaced(40, -2.3, -2.3 + 3.3 * 2.0 * pi / omega);
    // x = Re[c exp(i tau)], c = gamma / (alpha - omega^2 + i delta omega), and its derivatives by the parameters.
    const std::complex<double> i(0.0, 1.0);
    const auto x_at = [&](double t, int which) {
        const std::complex<double> below = alpha - omega * omega + i * delta * omega;
        const std::complex<double> wave = gamma / below * std::exp(i * (phase + omega * t));
        const std::complex<double> slopes[] = {wave * (i * t - (-2.0 * omega + i * delta) / below),
                                               -wave * i * omega / below,
                                               wave / gamma,
                                               -wave / below,
                                               wave * i,
                                               wave};
        return slopes[which].real();
    };
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.start = picked(binding);
    WaveformRecord record;
    record.label = "run1";
    record.binding = binding;
    record.times = times;
    record.values.resize(1, times.size());
    for (Index k = 0; k < times.size(); ++k)
        record.values(0, k) = x_at(times(k), 5) + 0.25;
    record.offsets = {{true, 0.0}};
    const WaveformResidual residual(system, {record}, options);
    REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
    const auto start = residual.initial_latents();
    // Phase of the scan: half of one of 256 places; the offset then is the mean of what is left.
    CHECK(std::abs(start[0](0) - phase) < pi / 256 + 1e-12);
    CHECK(std::abs(start[0](1) - 0.25) < 0.01);

    const auto value = residual.evaluate(residual.initial_set(), options.start, {Eigen::Vector2d(phase, 0.25)}, true);
    REQUIRE(value[0].status == estimator::BlockStatus::ok);
    // Measured 6.5e-14, times ten.
    CHECK(value[0].e.cwiseAbs().maxCoeff() < 7e-13);
    for (int j = 0; j < 4; ++j)
        for (Index k = 0; k < times.size(); ++k)
            CHECK(std::abs(value[0].e_theta(k, j) + x_at(times(k), j)) < 1e-10);
    for (Index k = 0; k < times.size(); ++k) {
        CHECK(std::abs(value[0].e_z(k, 0) + x_at(times(k), 4)) < 1e-11);
        CHECK(value[0].e_z(k, 1) == -1.0);
    }
}

// Bounds: ten times what was measured, which is rounding of the flow over the step (an orbit of period 2 near its
// doubling and the pendulum are sensitive).
TEST_CASE("derivatives of waveforms against differences", "[periodic][waveform]") {
    SECTION("Duffing, two excitations of different parameters, one orbit of period 1 and offsets") {
        const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
        WaveformOptions options;
        options.channels = channels_of(*system, {"x_dot", "x"});
        std::vector<WaveformRecord> records;
        for (const double omega : {0.9, 1.6}) {
            const VectorXd values =
                with_values(*system, {{"delta", 0.2}, {"alpha", 1.0}, {"beta", 0.8}, {"gamma", 0.7}, {"omega", omega}});
            const auto binding = estimated(*system, values, {"beta", "omega", "delta"});
            options.start = picked(binding);
            const VectorXd times = VectorXd::LinSpaced(50, 0.1, 15.0);
            const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(0.1, 0.0), {}, times, 0.4, 300.0);
            records.push_back(record_of(binding, times, y, options.channels));
            records.back().offsets = {{true, 0.0}, {false, 0.1}};
            if (omega > 1.0) records.back().phase = {false, 0.4};
        }
        options.start(1) = 1.2;  // one omega for both, as the estimator sees it
        const WaveformResidual residual(system, records, options);
        REQUIRE(residual.layout()[0].latents == 2);
        REQUIRE(residual.layout()[1].latents == 1);
        CHECK(derivative_error(residual, options.start, residual.initial_latents(), 7e-4) < 1e-10);
    }
    SECTION("Duffing in its two wells, an orbit of period 2") {
        const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
        const VectorXd values = with_values(*system, {{"gamma", 0.29}});
        const auto binding = estimated(*system, values, {"delta", "gamma", "omega"});
        WaveformOptions options;
        options.channels = channels_of(*system, {"x"});
        options.start = picked(binding);
        const VectorXd times = VectorXd::LinSpaced(60, 0.0, 30.0);
        const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(1.0, 0.0), {}, times, 0.0, 2000.0);
        WaveformRecord record = record_of(binding, times, y, options.channels);
        record.period = 2;
        const WaveformResidual residual(system, {record}, options);
        REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
        CHECK(derivative_error(residual, options.start, residual.initial_latents(), 2e-4) < 2e-8);
    }
    SECTION("landing gear with dry friction") {
        const std::shared_ptr<const models::System> system = models::make_system("landing_gear_damper", "");
        const VectorXd values = system->default_parameters();
        const auto binding = estimated(*system, values, {"c_rebound", "friction", "kappa", "p0"});
        WaveformOptions options;
        options.channels = channels_of(*system, {"stroke"});
        options.start = picked(binding);
        const VectorXd times = VectorXd::LinSpaced(80, 0.0, 1.1);
        const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(0.14, 0.0), {}, times, 1.0, 20.0);
        const WaveformResidual residual(system, {record_of(binding, times, y, options.channels)}, options);
        REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
        CHECK(derivative_error(residual, options.start, residual.initial_latents(), 3e-4) < 5e-11);
    }
    SECTION("rotating pendulum, difference of encoder readings, omega estimated") {
        const std::shared_ptr<const models::System> system = models::make_system("parametric_pendulum", "");
        const VectorXd values = with_values(*system, {{"omega", 13.0}});
        const auto binding = estimated(*system, values, {"l", "k2", "omega"});
        WaveformOptions options;
        options.channels = channels_of(*system, {"phi", "phi_dot"});
        options.start = picked(binding);
        models::Sensor sensor;
        sensor.type = models::Sensor::Type::angle_difference;
        sensor.delay = 0.015;
        const VectorXd times = VectorXd::LinSpaced(50, 0.3, 1.3);
        const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(0.0, 13.0), sensor, times, 0.2, 80.0);
        WaveformRecord record = record_of(binding, times, y, options.channels);
        record.sensor = sensor;
        record.offsets = {{true, 0.0}, {false, 0.0}};
        const WaveformResidual residual(system, {record}, options);
        REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
        CHECK(derivative_error(residual, options.start, residual.initial_latents(), 4e-4) < 4e-8);
    }
    SECTION("van der Pol, autonomous, T unknown, a formula as reading") {
        const std::shared_ptr<const models::System> system = models::make_system("van_der_pol", "");
        const VectorXd values = with_values(*system, {{"mu", 1.3}});
        const auto binding = estimated(*system, values, {"mu"});
        WaveformOptions options;
        options.channels = channels_of(*system, {"x"});
        options.start = picked(binding);
        models::Sensor sensor;
        sensor.type = models::Sensor::Type::function;
        sensor.functions = {
            {0, models::Expression::parse("x + 0.2 * x_dot + mu * x^2",
                                          models::reading_names(system->coordinates(), system->parameters()))}};
        const VectorXd times = VectorXd::LinSpaced(70, 3.0, 25.0);
        const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(1.0, 0.0), sensor, times, 0.0, 100.0);
        WaveformRecord record = record_of(binding, times, y, options.channels);
        record.sensor = sensor;
        record.time = 6.0;
        const WaveformResidual residual(system, {record}, options);
        REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
        CHECK(derivative_error(residual, options.start, residual.initial_latents(), 7e-4) < 7e-11);
        // Away from where it started, where the plane of phase zero is no longer across the flow.
        CHECK(derivative_error(residual, VectorXd::Constant(1, 1.5), residual.initial_latents(), 7e-4) < 7e-11);
    }
}

}  // namespace waveform_derivatives_test
