// Waveform residuals beyond their derivatives: which orbit, what when it vanishes, what is refused.

#include "periodic/waveforms/waveform_residual.hpp"

#include <oneapi/tbb/task_arena.h>

#include <cmath>
#include <limits>
#include <memory>

#include "estimator/estimate/estimate.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/steady_state.hpp"

namespace waveform_residual_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::WaveformOptions;
using periodic::WaveformRecord;
using periodic::WaveformResidual;

namespace {

constexpr double missing = std::numeric_limits<double>::quiet_NaN();

/// A hardening spring: x'' + 0.1 x' + x + x^3 = 0.5 cos(omega t). Near omega = 1.6 a large and a small steady state.
VectorXd hardening(const models::System& system, double omega) {
    return with_values(system, {{"delta", 0.1}, {"alpha", 1.0}, {"beta", 1.0}, {"gamma", 0.5}, {"omega", omega}});
}

/// A record of the steady state that motion from a state reaches.
WaveformRecord record_from(const models::System& system, const models::ParameterBinding& binding, const VectorXd& state,
                           const std::vector<periodic::WaveformChannel>& channels, const std::string& label,
                           double phase = 0.7) {
    const VectorXd times = VectorXd::LinSpaced(90, 0.2, 17.0);
    const MatrixXd y = steady_readings(system, binding.base, state, {}, times, phase, 400.0);
    WaveformRecord record = record_of(binding, times, y, channels);
    record.label = label;
    return record;
}

/// The largest reading of a record.
double height(const WaveformRecord& record) {
    return record.values.row(0).maxCoeff();
}

}  // namespace

TEST_CASE("steady states of several excitations give parameters, phases and offsets back", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.channels[0].scale = {false, 1e-3, {}};
    options.start = Eigen::Vector3d(0.14, 1.3, 0.7);
    std::vector<WaveformRecord> records;
    const double phases[] = {0.7, -2.0, 4.0};
    for (int r = 0; r < 3; ++r) {
        const VectorXd values = hardening(*system, 0.7 + 0.3 * r);
        records.push_back(record_from(*system, estimated(*system, values, {"delta", "alpha", "beta"}),
                                      Eigen::Vector2d(0.0, 0.0), options.channels, "run" + std::to_string(r + 1),
                                      phases[r]));
        records.back().values.array() += 0.05 * r;
        records.back().offsets = {{true, 0.0}};
    }
    WaveformResidual residual(system, records, options);
    std::vector<estimator::FreeParameter> parameters(3);
    for (std::size_t i = 0; i < 3; ++i) {
        parameters[i].name = std::string(1, static_cast<char>('a' + i));
        parameters[i].start = options.start(static_cast<Index>(i));
        parameters[i].typical_size = 0.1;
    }
    const estimator::Estimate estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CHECK(estimate.counts[0].used == 3);
    const double truth[] = {0.1, 1.0, 1.0};
    for (std::size_t i = 0; i < 3; ++i) {
        CAPTURE(i);
        // 400 s leave exp(-0.05 * 400) = 2e-9 of the transient in the data, which decides.
        CHECK(std::abs(estimate.parameters[i].value - truth[i]) < 2e-7);
    }
    for (std::size_t b = 0; b < 3; ++b) {
        CHECK(std::abs(models::wrapped(estimate.latents[0][b](0) - phases[b])) < 1e-7);
        CHECK(std::abs(estimate.latents[0][b](1) - 0.05 * static_cast<double>(b)) < 1e-8);
    }
}

TEST_CASE("of coexisting steady states the measured one is taken", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const VectorXd values = hardening(*system, 1.7);
    const auto binding = estimated(*system, values, {"delta", "beta"});
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.start = picked(binding);
    const WaveformRecord small =
        record_from(*system, binding, Eigen::Vector2d(0.0, 0.0), options.channels, "small", 0.0);
    const WaveformRecord large =
        record_from(*system, binding, Eigen::Vector2d(1.6, 0.5), options.channels, "large", 0.0);
    REQUIRE(height(large) > 2.0 * height(small));
    const WaveformResidual residual(system, {small, large}, options);
    const auto latents = residual.initial_latents();
    const auto value = residual.evaluate(residual.initial_set(), options.start, latents, false);
    for (std::size_t b = 0; b < 2; ++b) {
        CAPTURE(b);
        REQUIRE(value[b].status == estimator::BlockStatus::ok);
        // The phase of the scan is within half a place of 256: an error of pi / 256 of the amplitude.
        CHECK(value[b].e.cwiseAbs().maxCoeff() < 0.02 * height(residual.records()[b]));
    }
}

TEST_CASE("a known phase leaves open in which period of a longer orbit the record begins", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const VectorXd values = with_values(*system, {{"gamma", 0.28}});
    const double forcing = system->period(values, models::Clock::time);
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    const auto binding = estimated(*system, values, {"delta"});
    options.start = picked(binding);
    std::vector<WaveformRecord> records;
    for (const int late : {0, 1}) {
        // The same motion on a clock that began one period of the forcing later: the phase is the same.
        const VectorXd times = VectorXd::LinSpaced(60, late * forcing, late * forcing + 30.0);
        const MatrixXd y =
            steady_readings(*system, values, Eigen::Vector2d(1.0, 0.0), {}, times, 0.0, 2000.0 + late * forcing);
        records.push_back(record_of(binding, times.array() - late * forcing, y, options.channels));
        records.back().period = 2;
        records.back().phase = {false, 0.0};
    }
    REQUIRE((records[0].values - records[1].values).cwiseAbs().maxCoeff() > 0.1);
    const WaveformResidual residual(system, records, options);
    const auto value = residual.evaluate(residual.initial_set(), options.start, residual.initial_latents(), false);
    for (std::size_t b = 0; b < 2; ++b) {
        CAPTURE(b);
        REQUIRE(value[b].status == estimator::BlockStatus::ok);
        CHECK(value[b].e.cwiseAbs().maxCoeff() < 1e-8);
    }
}

TEST_CASE("a steady state that vanishes is a block that failed, and comes back", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    // On the upper branch, which ends in a fold above omega = 2.
    const VectorXd values = hardening(*system, 1.7);
    const auto binding = estimated(*system, values, {"omega"});
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.start = picked(binding);
    const WaveformResidual residual(
        system, {record_from(*system, binding, Eigen::Vector2d(1.6, 0.5), options.channels, "run1")}, options);
    const auto latents = residual.initial_latents();
    const auto status_at = [&](double omega) {
        return residual.evaluate(residual.initial_set(), VectorXd::Constant(1, omega), latents, true)[0].status;
    };
    CHECK(status_at(1.75) == estimator::BlockStatus::ok);
    CHECK(status_at(4.0) == estimator::BlockStatus::failed);
    CHECK(status_at(-1.0) == estimator::BlockStatus::failed);
    CHECK(status_at(missing) == estimator::BlockStatus::failed);
    CHECK(residual.solutions(residual.initial_set(), VectorXd::Constant(1, 4.0))[0].status != OrbitStatus::converged);
    CHECK(residual.solutions(residual.initial_set(), VectorXd::Constant(1, 1.75))[0].status == OrbitStatus::converged);

    const VectorXd scale = VectorXd::Ones(1);
    estimator::ActiveSet active = residual.initial_set();
    for (int round = 0; round < 4; ++round) {
        CAPTURE(round);
        const auto lost = residual.update_active_set(active, VectorXd::Constant(1, 4.0), latents, scale);
        CHECK(lost.changed);
        CHECK(lost.lost == 1);
        CHECK_FALSE(active.layout[0].active);
        CHECK(residual.evaluate(active, VectorXd::Constant(1, 1.7), latents, true)[0].e.size() == 0);
        const auto found = residual.update_active_set(active, VectorXd::Constant(1, 1.7), latents, scale);
        // Twice, and once more where nothing else changes: refreshing must end.
        CHECK(found.added == (round < 3 ? 1 : 0));
        CHECK(active.layout[0].active == (round < 3));
        if (round < 3)
            CHECK_FALSE(residual.update_active_set(active, VectorXd::Constant(1, 1.7), latents, scale).changed);
    }
}

TEST_CASE("an unstable limit cycle from its measured states", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("lorenz", "");
    const VectorXd values = system->default_parameters();
    const auto binding = estimated(*system, values, {"rho", "sigma"});
    const FlowOrbit shortest = read_flow_orbits("lorenz").orbits.front();
    periodic::StartingSolution start;
    start.points = shortest.point;
    start.time = shortest.time;
    const auto orbit = periodic::solve_orbit(*system, values, start, {});
    REQUIRE(orbit.status == OrbitStatus::converged);
    WaveformOptions options;
    options.channels = channels_of(*system, {"x", "y", "z"});
    options.start = picked(binding);
    const VectorXd times = VectorXd::LinSpaced(156, 0.0, 0.99 * orbit.time);
    const MatrixXd y = steady_readings(*system, values, orbit.points.col(0), {}, times, 0.0, 0.0);
    WaveformRecord record = record_of(binding, times, y, options.channels);
    record.time = 1.4;
    const WaveformResidual residual(system, {record}, options);
    REQUIRE(residual.start_status(0) == OrbitStatus::converged);
    const auto found = residual.solutions(residual.initial_set(), options.start);
    CHECK(std::abs(found[0].time - orbit.time) < 1e-9);
    CHECK_THAT(found[0].multipliers.front().real(), WithinRel(shortest.unstable_multiplier, 1e-8));
}

TEST_CASE("waveform layout: missing readings, known phases, channels", "[periodic][waveform][threads]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const auto binding = estimated(*system, hardening(*system, 0.8), {"delta"});
    WaveformOptions options;
    options.channels = channels_of(*system, {"x", "x_dot"});
    options.channels[0].distribution = estimator::AutoregressiveErrors{};
    options.channels[1].floor = 1e-4;
    options.start = picked(binding);
    WaveformRecord first = record_from(*system, binding, Eigen::Vector2d(0.0, 0.0), options.channels, "run1");
    WaveformRecord second = first;
    second.label = "run2";
    first.values(0, 5) = missing;
    first.values(1, 0) = missing;
    first.offsets = {{false, 0.0}, {true, 0.0}};
    second.values.row(1).setConstant(missing);
    second.phase = {false, 0.7};
    const WaveformResidual residual(system, {first, second}, options);
    CHECK(residual.type() == "waveform");
    CHECK(residual.structure() == estimator::LatentStructure::independent_blocks);
    REQUIRE(residual.groups().size() == 2);
    CHECK(residual.groups()[0].name == "waveform.x");
    CHECK(residual.groups()[1].name == "waveform.x_dot");
    CHECK(residual.groups()[1].unit == "1/s");
    CHECK(residual.groups()[1].floor == 1e-4);
    CHECK(residual.groups()[0].ordered);
    CHECK_THAT(residual.groups()[0].interval, WithinRel(16.8 / 89.0, 1e-12));
    CHECK(std::holds_alternative<estimator::AutoregressiveErrors>(residual.groups()[0].distribution));
    const auto& layout = residual.layout();
    REQUIRE(layout.size() == 2);
    CHECK(layout[0].label == "waveform, run1");
    CHECK(layout[0].group.size() == 178);
    CHECK(layout[0].latents == 2);
    CHECK(layout[1].group.size() == 90);
    CHECK(layout[1].latents == 0);
    const auto latents = residual.initial_latents();
    const auto value = residual.evaluate(residual.initial_set(), options.start, latents, true);
    CHECK(value[1].e.cwiseAbs().maxCoeff() < 1e-7);
    CHECK(residual.sources(0)[5].sample == 6);
    CHECK(residual.alignment(0, latents[0]).offsets(0) == 0.0);
    CHECK(residual.alignment(1, latents[1]).phase == 0.7);

    // The same bytes on one thread.
    oneapi::tbb::task_arena one(1);
    one.execute([&] {
        const WaveformResidual again(system, {first, second}, options);
        const auto other = again.evaluate(again.initial_set(), options.start, again.initial_latents(), true);
        for (std::size_t b = 0; b < 2; ++b) {
            CHECK(other[b].e == value[b].e);
            CHECK(other[b].e_theta == value[b].e_theta);
            CHECK(other[b].e_z == value[b].e_z);
        }
    });
}

TEST_CASE("a record without an orbit is inactive and says why", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const auto binding = estimated(*system, hardening(*system, 0.8), {"delta"});
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.start = picked(binding);
    WaveformRecord good = record_from(*system, binding, Eigen::Vector2d(0.0, 0.0), options.channels, "good");
    WaveformRecord bad = good;
    // An orbit of two periods that is none: it closes after one.
    bad.period = 2;
    bad.label = "bad";
    WaveformResidual residual(system, {good, bad}, options);
    CHECK(residual.start_status(0) == OrbitStatus::converged);
    CHECK(residual.start_status(1) == OrbitStatus::shorter_period);
    CHECK_FALSE(residual.layout()[1].active);
    CHECK(residual.solutions(residual.initial_set(), options.start)[1].status == OrbitStatus::shorter_period);
    const auto value = residual.evaluate(residual.initial_set(), options.start, residual.initial_latents(), true);
    CHECK(value[0].e.size() == 90);
    CHECK(value[1].e.size() == 0);
    estimator::ActiveSet active = residual.initial_set();
    CHECK_FALSE(
        residual.update_active_set(active, options.start, residual.initial_latents(), VectorXd::Ones(1)).changed);
}

TEST_CASE("wrong calls of waveform residuals are refused by name", "[periodic][waveform]") {
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const auto binding = estimated(*system, hardening(*system, 0.8), {"delta"});
    WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.start = picked(binding);
    const WaveformRecord good = record_from(*system, binding, Eigen::Vector2d(0.0, 0.0), options.channels, "run1");
    const auto refused = [&](const auto& change, const std::string& message) {
        WaveformRecord record = good;
        WaveformOptions other = options;
        change(record, other);
        CHECK_THROWS_WITH(WaveformResidual(system, {record}, other), ContainsSubstring(message));
    };
    refused([](auto& r, auto&) { r.times(4) = r.times(3); }, "run1: times must ascend");
    refused([](auto& r, auto&) { r.times(4) = missing; }, "run1: time 4 is not a finite number");
    refused([](auto& r, auto&) { r.values(0, 2) = std::numeric_limits<double>::infinity(); }, "values must be finite");
    refused([](auto& r, auto&) { r.values.setConstant(missing); }, "run1: 0 readings for 1 unknown");
    refused([](auto& r, auto&) { r.values.conservativeResize(1, 3); }, "values have shape (1, 3)");
    refused([](auto& r, auto&) { r.period = 3; }, "run1: lasts 16.99 s, its orbit 23.56 s");
    refused([](auto& r, auto&) { r.period = 0; }, "period is 0, must lie in [1, 64]");
    refused([](auto& r, auto&) { r.time = 2.0; }, "is forced, its orbits last whole periods");
    refused([](auto& r, auto&) { r.phase = {false, 6.3}; }, "phase is 6.3 rad, must lie within");
    refused([](auto& r, auto&) { r.phase = {false, missing}; }, "phase is nan rad, must lie within");
    refused([](auto& r, auto&) { r.offsets = {{}, {}}; }, "2 offsets for 1 channels");
    refused([](auto& r, auto&) { r.offsets = {{false, missing}}; }, "a known offset must be a finite number");
    refused(
        [](auto& r, auto&) {
            r.binding.base(0) = -1.0;
            r.binding.parameter.clear();
            r.binding.estimated.clear();
        },
        "delta starts at -1, must be >= 0");
    refused([](auto&, auto& o) { o.start.resize(2); }, "2 parameters at the start, must be 1");
    refused([](auto&, auto& o) { o.channels.clear(); }, "at least one channel");
    refused([](auto&, auto& o) { o.channels.push_back(o.channels[0]); }, "coordinate x is read by two channels");
    refused([](auto&, auto& o) { o.channels[0].coordinate = 2; }, "channel of coordinate 2: model duffing has 2");
    refused([](auto&, auto& o) { o.channels[0].known_sds = true; }, "reading 0 of x has no known sd > 0");
    refused([](auto&, auto& o) { o.channels[0].distribution = estimator::LogNormalErrors{}; }, "must be > 0");
    refused([](auto&, auto& o) { o.maximum_move = 0.0; }, "maximum_move is 0, must be > 0");
    refused(
        [](auto& r, auto& o) {
            o.channels[0].distribution = estimator::AutoregressiveErrors{};
            r.times.tail(80).array() += 0.1;
        },
        "autoregressive errors need one sampling interval");
    CHECK_THROWS_WITH(WaveformResidual(system, {}, options), ContainsSubstring("at least one record"));

    const std::shared_ptr<const models::System> cycle = models::make_system("van_der_pol", "");
    WaveformRecord record = good;
    record.binding = estimated(*cycle, cycle->default_parameters(), {"mu"});
    options.start = picked(record.binding);
    CHECK_THROWS_WITH(WaveformResidual(cycle, {record}, options),
                      ContainsSubstring("model van_der_pol is autonomous, a guess > 0 of its period is needed"));
    record.time = 6.0;
    record.phase = {false, 0.0};
    CHECK_THROWS_WITH(WaveformResidual(cycle, {record}, options), ContainsSubstring("is unknown by nature"));
    record.phase = {true, 0.0};
    record.period = 2;
    CHECK_THROWS_WITH(WaveformResidual(cycle, {record}, options),
                      ContainsSubstring("that of an autonomous model is 1"));
    const std::shared_ptr<const models::System> map = models::make_system("henon", "");
    CHECK_THROWS_WITH(WaveformResidual(map, {record}, options), ContainsSubstring("is a map and has no waveforms"));
    const std::shared_ptr<const models::System> measured = models::make_system("landing_gear_damper", "measured_base");
    CHECK_THROWS_WITH(WaveformResidual(measured, {record}, options), ContainsSubstring("reads measured inputs"));
}

}  // namespace waveform_residual_test
