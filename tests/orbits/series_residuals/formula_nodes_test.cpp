// Multiple shooting of series that are read by formulas: nodes are latent states that no reading says.

#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "models/equations/equation_text.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/simulation/state_filter.hpp"
#include "orbits/simulation/state_track.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace formula_nodes_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::base_theta;
using tests::bound;
using tests::ContainsSubstring;
using tests::derivative_error;
using tests::WithinAbs;

namespace {

/// Models as texts: those of this file would be compiled without optimisation.
std::shared_ptr<const models::System> from_text(const models::EquationText& text) {
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    if (system == nullptr) throw std::logic_error(problems.front().rule);
    return system;
}

/// The Lorenz equations with an instrument of their own: a laser whose intensity gain x^2 + offset is read.
std::shared_ptr<const models::System> laser() {
    models::EquationText text;
    text.coordinates = {{"x", "sigma * (y - x)"}, {"y", "x * (rho - z) - y"}, {"z", "x * y - beta * z"}};
    text.parameters = {{"sigma", "1", models::positive, 10.0},
                       {"rho", "1", models::positive, 28.0},
                       {"beta", "1", models::positive, 8.0 / 3.0},
                       {"gain", "1", models::positive, 0.9},
                       {"offset", "1", models::any_real, 12.0}};
    text.used_outside = {"gain", "offset"};
    return from_text(text);
}

/// A damped oscillator that an input drives, and its displacement behind a lag, which moves nothing.
std::shared_ptr<const models::System> rig() {
    models::EquationText text;
    text.coordinates = {{"x", "v"}, {"v", "u - k * x - c * v"}, {"s", "x - 0.5 * s"}};
    text.parameters = {{"k", "1/s^2", models::positive, 4.0},
                       {"c", "1/s", models::positive, 0.3},
                       {"gain", "1", models::positive, 1.5}};
    text.inputs = {{"u", "", "m/s^2"}};
    text.used_outside = {"gain"};
    return from_text(text);
}

models::Sensor reads(const models::System& system, std::size_t coordinate, const std::string& formula) {
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::function;
    const auto names = models::reading_names(system.coordinates(), system.parameters(), system.inputs());
    sensor.functions.push_back({coordinate, models::Expression::parse(formula, names)});
    return sensor;
}

/// One segment of which only the coordinate that the formula replaces is data.
Series simulated(const models::System& system, const models::Sensor& sensor, Eigen::Index count, double step,
                 double noise, std::uint64_t seed, const Eigen::VectorXd& start, std::size_t transient) {
    VirtualExperimentOptions options;
    options.plan = SamplePlan{step, static_cast<std::size_t>(count), transient};
    options.initial = start;
    options.sensor = sensor;
    options.noise = Eigen::VectorXd::Zero(system.dimension());
    options.noise[static_cast<Eigen::Index>(sensor.functions.front().coordinate)] = noise;
    options.seed = seed;
    Series series = simulate(system, system.default_parameters(), options).series;
    const auto row = static_cast<Eigen::Index>(sensor.functions.front().coordinate);
    series.coordinates = {series.coordinates[static_cast<std::size_t>(row)]};
    for (Segment& segment : series.segments)
        segment.values = segment.values.row(row).eval();
    return series;
}

std::vector<estimator::FreeParameter> parameters(const models::System& system, const models::ParameterBinding& binding,
                                                 const Eigen::VectorXd& start) {
    std::vector<estimator::FreeParameter> result;
    for (std::size_t j = 0; j < binding.parameter.size(); ++j) {
        const models::Parameter& entry = system.parameters()[static_cast<std::size_t>(binding.parameter[j])];
        estimator::FreeParameter p;
        p.name = entry.name;
        p.start = start[static_cast<Eigen::Index>(j)];
        p.typical_size = std::abs(p.start);
        result.push_back(p);
    }
    return result;
}

estimator::Estimate estimated(const models::System& system, const models::ParameterBinding& binding,
                              const Eigen::VectorXd& start, const estimator::Residual& residual) {
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    return estimator::estimate(parameters(system, binding, start), {&residual}, {}, options);
}

const std::vector<std::string> laser_names{"sigma", "rho", "beta", "gain", "offset"};
constexpr std::array<std::array<double, 5>, 4> laser_starts{{{1.15, 0.88, 1.12, 0.85, 1.2},
                                                             {0.85, 1.12, 0.9, 1.18, 0.8},
                                                             {1.2, 1.1, 0.82, 0.88, 1.15},
                                                             {0.9, 0.85, 1.15, 1.1, 0.85}}};

}  // namespace

TEST_CASE("a chaotic record read by gain x^2 + offset gives its parameters by multiple shooting",
          "[orbits][shooting]") {
    const auto system = laser();
    const auto binding = bound(*system, system->default_parameters(), laser_names);
    const Eigen::VectorXd truth = base_theta(binding);
    const models::Sensor sensor = reads(*system, 0, "gain * x^2 + offset");
    for (std::uint64_t seed = 1; seed <= laser_starts.size(); ++seed) {
        CAPTURE(seed);
        // 30 s are 27 Lyapunov times; readings reach 330.
        const Eigen::Vector3d from(1.0 + static_cast<double>(seed), 2.0, 20.0);
        const Series series = simulated(*system, sensor, 3001, 0.01, 1.5, seed, from, 1000);
        const auto& factors = laser_starts[seed - 1];
        const Eigen::VectorXd start = truth.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(factors.data(), 5));
        ShootingOptions options;
        options.sensor = sensor;
        options.start = start;
        const ShootingResidual residual(system, binding, series, options);
        CHECK(residual.interval() > 1);
        const auto estimate = estimated(*system, binding, start, residual);
        CHECK(estimate.status == estimator::EstimateStatus::converged);
        for (std::size_t j = 0; j < laser_names.size(); ++j) {
            CAPTURE(laser_names[j], estimate.parameters[j].value, estimate.parameters[j].sd);
            const double off = estimate.parameters[j].value - truth[static_cast<Eigen::Index>(j)];
            CHECK(std::abs(off) < 4.0 * estimate.parameters[j].sd);
            CHECK(estimate.parameters[j].sd < 0.01 * truth[static_cast<Eigen::Index>(j)]);
        }
    }
}

TEST_CASE("nodes between readings by formulas have exact derivatives", "[orbits][shooting]") {
    const auto system = laser();
    const auto binding = bound(*system, system->default_parameters(), laser_names);
    ShootingOptions options;
    options.sensor = reads(*system, 0, "gain * x^2 + offset");
    options.interval = 7;
    const Series series = simulated(*system, options.sensor, 120, 0.01, 0.5, 5, Eigen::Vector3d(3.0, 2.0, 20.0), 1000);
    const ShootingResidual residual(system, binding, series, options);
    REQUIRE(residual.layout().size() == 18);
    // Central differences of readings up to 300 with steps of 1e-5: measured 3e-6.
    CHECK(derivative_error(residual, base_theta(binding), residual.initial_latents()) < 3e-5);
}

TEST_CASE("nodes and whole segments give the same estimate of a driven rig read by a formula", "[orbits][shooting]") {
    const auto bare = rig();
    std::vector<double> times, values;
    for (int k = 0; k <= 120; ++k) {
        times.push_back(0.1 * k);
        values.push_back(2.0 * std::sin(0.37 * k) + std::cos(0.11 * k * k));
    }
    const auto signal =
        std::make_shared<models::InputSignal>(times, values, 1, models::InputSignal::Interpolation::cubic);
    const auto system = bare->with_input(signal);
    const models::Sensor sensor = reads(*bare, 0, "gain * exp(0.4 * x) + 0.2 * s");
    const Series series = simulated(*system, sensor, 401, 0.03, 0.01, 3, Eigen::Vector3d(0.4, -0.2, 0.1), 0);
    const auto binding = bound(*bare, bare->default_parameters(), {"k", "c", "gain"});
    const Eigen::VectorXd start = base_theta(binding).cwiseProduct(Eigen::Vector3d(1.15, 0.8, 0.85));

    SeriesResidualOptions whole;
    whole.sensor = sensor;
    whole.inputs = {signal};
    whole.start = start;
    const SeriesResidual segment(bare, binding, series, whole);
    const auto by_segment = estimated(*bare, binding, start, segment);
    REQUIRE(by_segment.status == estimator::EstimateStatus::converged);

    for (const Eigen::Index interval : {0, 25}) {
        CAPTURE(interval);
        ShootingOptions options;
        options.sensor = sensor;
        options.inputs = {signal};
        options.start = start;
        options.interval = interval;
        const ShootingResidual nodes(bare, binding, series, options);
        const auto by_nodes = estimated(*bare, binding, start, nodes);
        CHECK(by_nodes.status == estimator::EstimateStatus::converged);
        for (std::size_t j = 0; j < 3; ++j) {
            const auto& one = by_segment.parameters[j];
            CAPTURE(one.name, one.value, one.sd);
            // Exact matching ends where its errors are 2e-5 of those of the readings.
            CHECK_THAT(by_nodes.parameters[j].value, WithinAbs(one.value, 0.02 * one.sd));
            CHECK_THAT(by_nodes.parameters[j].sd, WithinAbs(one.sd, 0.02 * one.sd));
            CHECK(std::abs(one.value - base_theta(binding)[static_cast<Eigen::Index>(j)]) < 4.0 * one.sd);
        }
    }
}

TEST_CASE("states are followed through a formula that bends back, on one side", "[orbits]") {
    const auto system = laser();
    const models::Sensor sensor = reads(*system, 0, "gain * x^2 + offset");
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.01, 1001, 1000};
    options.initial = Eigen::Vector3d(1.0, 2.0, 20.0);
    const Eigen::MatrixXd truth = simulate(*system, system->default_parameters(), options).series.segments[0].values;
    const Series series = simulated(*system, sensor, 1001, 0.01, 0.5, 4, Eigen::Vector3d(1.0, 2.0, 20.0), 1000);
    const StateTrack track = track_states(*system, system->default_parameters(), series, 0, sensor);
    REQUIRE(track.states.cols() == truth.cols());
    // The mirror image (-x, -y, z) reads the same.
    const double side = track.states(0, 0) * truth(0, 0) > 0.0 ? 1.0 : -1.0;
    const Eigen::Vector3d signs(side, side, 1.0);
    const Eigen::MatrixXd error = signs.asDiagonal() * track.states - truth;
    // At the true parameters, readings good to 0.15 % of their range: errors of the states of the same order.
    CHECK(std::sqrt(error.row(0).squaredNorm() / 1001.0) < 0.05);
    CHECK(std::sqrt(error.row(2).squaredNorm() / 1001.0) < 0.1);
    CHECK(track.reading_sd[0] > 0.3);
    CHECK(track.reading_sd[0] < 1.0);
}

TEST_CASE("following a record costs what its flows cost, and errors are looked for up to a limit", "[orbits]") {
    const auto system = laser();
    const models::Sensor sensor = reads(*system, 0, "gain * x^2 + offset");
    const Series series = simulated(*system, sensor, 601, 0.01, 0.5, 4, Eigen::Vector3d(1.0, 2.0, 20.0), 1000);
    const Eigen::VectorXd theta = system->default_parameters();
    std::uint64_t work = 7;
    (void)track_states(*system, theta, series, 0, sensor, {}, {}, &work);
    // At least a step per sample on each of 34 ways over 500 samples, with three directions.
    CHECK(work > 34 * 500 * 4);
    const std::uint64_t once = work - 7;
    (void)track_states(*system, theta, series, 0, sensor, {}, {}, &work);
    CHECK(work == 7 + 2 * once);

    FollowedRecord record{*system,
                          theta,
                          sensor,
                          models::Clock::time,
                          std::vector<double>(601, 0.0),
                          series.segments[0].times,
                          {0},
                          {0},
                          series.segments[0].values,
                          Eigen::Vector3d(40.0, 50.0, 50.0),
                          {},
                          {}};
    const Eigen::Vector3d first(1.0, 2.0, 20.0);
    const Eigen::VectorXd sd = Eigen::VectorXd::Constant(1, 0.5);
    const FilteredStates all = followed_states(record, first, sd);
    const FilteredStates none = followed_states(record, first, sd, 0);
    // The first look is always made, and the whole way.
    CHECK(none.work < all.work / 5);
    CHECK(none.states.cols() == 601);
    CHECK(all.misfit <= none.misfit);
}

TEST_CASE("readings that say nothing of a state have no nodes", "[orbits]") {
    const auto system = laser();
    const auto binding = bound(*system, system->default_parameters(), laser_names);
    ShootingOptions options;
    options.sensor = reads(*system, 0, "gain + offset");
    const Series nothing = simulated(*system, options.sensor, 200, 0.01, 0.5, 1, Eigen::Vector3d(1.0, 2.0, 20.0), 0);
    CHECK_THROWS_WITH(ShootingResidual(system, binding, nothing, options),
                      ContainsSubstring("readings say nothing of the state"));

    const auto bare = rig();
    const std::vector<double> times{0.0, 10.0}, values{1.0, -1.0};
    const auto signal =
        std::make_shared<models::InputSignal>(times, values, 1, models::InputSignal::Interpolation::linear);
    ShootingOptions part;
    part.sensor = reads(*bare, 0, "gain * exp(0.4 * x)");
    part.inputs = {signal};
    const Series series =
        simulated(*bare->with_input(signal), part.sensor, 300, 0.03, 0.01, 1, Eigen::Vector3d(0.4, -0.2, 0.1), 0);
    CHECK_THROWS_WITH(ShootingResidual(bare, bound(*bare, bare->default_parameters(), {"k"}), series, part),
                      ContainsSubstring("readings say nothing of s, now or later"));
}

}  // namespace formula_nodes_test
