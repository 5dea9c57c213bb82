#include "orbits/simulation/virtual_experiment.hpp"

#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/simulation/attractor_detection.hpp"
#include "tests/catch.hpp"

namespace virtual_experiment_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double pi = std::numbers::pi;

/// The pendulum of the simulated record; k1 and g as asked for, the rest as in the paper.
Eigen::VectorXd pendulum_parameters(const models::System& system, double g, double k1) {
    Eigen::VectorXd theta = system.default_parameters();
    const auto set = [&](std::string_view name, double value) { theta[system.parameter_index(name)] = value; };
    set("m", 0.0858);
    set("l", 0.317);
    set("k1", k1);
    set("k2", 4.85e-4);
    set("k3", 1.90e-4);
    set("g", g);
    set("A", 0.131);
    set("omega", 9.09);
    set("epsilon", 0.173);
    return theta;
}

/// Eigen's copy of a fixed pair into a vector of any length sets off a false alarm of GCC 12 (-Warray-bounds).
Eigen::VectorXd pair(double first, double second) {
    Eigen::VectorXd values(2);
    values << first, second;
    return values;
}

bool same(const Series& a, const Series& b) {
    if (a.segments.size() != b.segments.size()) return false;
    for (std::size_t s = 0; s < a.segments.size(); ++s) {
        if (a.segments[s].values.cols() != b.segments[s].values.cols()) return false;
        if (a.segments[s].values != b.segments[s].values) return false;
    }
    return true;
}

}  // namespace

TEST_CASE("sections are the states of the flow after the transient", "[orbits]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 0.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{7, 3};
    options.trajectories = 2;
    options.initial = (Eigen::Matrix2d() << 0.3, -1.0, 2.0, 5.0).finished();
    options.phase = 0.4;
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.complete);
    CHECK(experiment.events.empty());
    CHECK(experiment.series.phase == 0.4);
    CHECK(experiment.series.sampling == Series::Sampling::section);
    CHECK(experiment.series.coordinates[0].angle);
    REQUIRE(experiment.series.segments.size() == 2);
    // 7 sections over 2 trajectories: 4 and 3.
    CHECK(experiment.series.segments[0].values.cols() == 4);
    CHECK(experiment.series.segments[1].values.cols() == 3);
    for (Eigen::Index trajectory = 0; trajectory < 2; ++trajectory) {
        const auto reference = system->ensemble(options.initial.col(trajectory), 0.4, 6, theta);
        const auto& values = experiment.series.segments[static_cast<std::size_t>(trajectory)].values;
        CHECK(values == reference.sections[0].middleCols(3, values.cols()));
    }
}

TEST_CASE("a record without transient begins with the start itself", "[orbits]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 0.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{1, 0};
    options.initial = pair(0.3, 2.0);
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.series.size() == 1);
    CHECK(experiment.series.segments[0].values.col(0) == Eigen::Vector2d(0.3, 2.0));
}

TEST_CASE("random starts fill the attractor, and the seed decides", "[orbits]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 0.0);
    // Velocities on the section lie within +-14.64 rad/s; probes on the attractor come close to that.
    const Eigen::VectorXd range = typical_range(*system, theta, 0.0, 0.0, 1);
    CHECK(range[0] == pi);
    CHECK(range[1] > 13.0);
    CHECK(range[1] < 15.5);

    VirtualExperimentOptions options;
    options.plan = SectionPlan{40, 5};
    options.trajectories = 4;
    options.seed = 1;
    const auto first = simulate(*system, theta, options);
    CHECK(same(first.series, simulate(*system, theta, options).series));
    options.seed = 2;
    CHECK_FALSE(same(first.series, simulate(*system, theta, options).series));
}

TEST_CASE("any number of threads gives the same record", "[orbits][threads]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 0.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{600, 20};
    options.trajectories = 5;
    options.noise = pair(1e-3, 1e-2);
    const auto parallel = simulate(*system, theta, options);
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    CHECK(same(parallel.series, simulate(*system, theta, options).series));
}

TEST_CASE("repetition is noticed at the end of a trajectory", "[orbits]") {
    // x = 2^-k transient onto a period-3 orbit 0, 1, 2 with an angle that turns by 2 pi beside it: the transient
    // is below 1e-9 of the range 4 once 2^-k (1 - 2^-3) 2^3 <= 4e-9.
    constexpr Eigen::Index count = 500;
    Eigen::MatrixXd sections(2, count);
    for (Eigen::Index k = 0; k < count; ++k) {
        sections(0, k) = static_cast<double>(k % 3) + std::ldexp(1.0, static_cast<int>(-k));
        sections(1, k) = (k % 2 == 0 ? 1.0 : -1.0) * pi;  // the same angle
    }
    const Eigen::Vector2d range(4.0, 2.0 * pi);
    const auto capture = captured(sections, {false, true}, range);
    REQUIRE(capture.has_value());
    CHECK(capture->period == 3);
    CHECK(capture->settled == 28);  // 7 * 2^-k <= 4e-9 holds from k = 31 on; its partner is 28

    CHECK_FALSE(captured(sections.leftCols(319), {false, true}, range).has_value());
    sections(0, count - 200) += 1e-8;  // within the watched 256
    CHECK_FALSE(captured(sections, {false, true}, range).has_value());
    CHECK_FALSE(captured(Eigen::MatrixXd(sections).setConstant(std::nan("")), {false, true}, range).has_value());

    Eigen::MatrixXd resting = Eigen::MatrixXd::Constant(2, 10, 1.0);
    resting(0, 3) = 1.1;
    CHECK(settled_at_last(resting, {false, true}, range) == 4);
}

// mathematics.md, section 6: with g = 9.8348933 a mirror pair of stable orbits of period 10 coexists with the chaos,
// one point being (1.45386491048, 13.65237565711).
TEST_CASE("a trajectory caught by the stable period-10 orbit is noticed and restarted", "[orbits][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.8348933, 0.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{2000, 10};
    options.trajectories = 2;
    options.initial = (Eigen::Matrix2d() << 1.45386491048, 0.3, 13.65237565711, 2.0).finished();
    options.restart = Restart::never;
    auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 1);
    const TrajectoryEvent& event = experiment.events[0];
    CHECK(event.kind == TrajectoryEvent::Kind::captured);
    CHECK(name(event.kind) == "captured");
    CHECK(event.trajectory == 0);
    CHECK(event.period == 10);
    CHECK(experiment.complete);
    CHECK(experiment.series.segments[0].values.cols() == 1000);
    // The state reported is on the orbit: one of its ten points is the reference's, given to 11 decimals.
    const auto orbit = system->ensemble(event.state, 0.0, 10, theta).sections[0];
    double nearest = 1.0;
    for (Eigen::Index k = 0; k < 10; ++k) {
        nearest = std::min(nearest, (orbit.col(k) - Eigen::Vector2d(1.45386491048, 13.65237565711)).norm());
    }
    // Integration error of the orbit: measured 1.7e-9 at tolerance 1e-12 (1.4e-8, 2.2e-10 and 2.5e-11 at 1e-11, 1e-13
    // and 1e-14, so it is the integrator's); bound ten times that.
    CHECK(nearest < 1.7e-8);

    options.restart = Restart::when_captured_or_at_rest;
    experiment = simulate(*system, theta, options);
    REQUIRE(experiment.complete);
    REQUIRE(experiment.events.size() >= 2);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::captured);
    CHECK(experiment.events[1].kind == TrajectoryEvent::Kind::restarted);
    // Nothing of the orbit is in the record: the points are all there, and no segment ends in repetition.
    CHECK(experiment.series.size() == 2000);
    const Eigen::Vector2d range(2.0 * pi, 30.0);
    for (const Segment& segment : experiment.series.segments) {
        CHECK_FALSE(captured(segment.values, {true, false}, range).has_value());
    }
}

TEST_CASE("a pendulum that stops is reported, and given up when every start stops", "[orbits]") {
    // Dry friction so strong that the support's acceleration never moves it: at rest within a few periods.
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 2.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{100, 50};
    options.initial = pair(0.3, 2.0);
    options.restart = Restart::never;
    auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::at_rest);
    CHECK(experiment.events[0].section <= 3);
    CHECK(experiment.complete);
    CHECK(experiment.series.size() == 100);

    options.restart = Restart::when_captured_or_at_rest;
    experiment = simulate(*system, theta, options);
    CHECK_FALSE(experiment.complete);
    CHECK_THAT(experiment.message, ContainsSubstring("trajectory 0 stopped 100 sections short") &&
                                       ContainsSubstring("20 times in a row") &&
                                       ContainsSubstring("the last time it came to rest"));
    CHECK(experiment.series.size() == 0);
    CHECK(experiment.events.size() == 39);  // 20 losses, 19 restarts
}

TEST_CASE("a step budget that does not suffice is reported, not thrown", "[orbits]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto theta = pendulum_parameters(*system, 9.81, 0.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{10, 0};
    options.flow.maximum_steps = 2;
    options.restart = Restart::never;
    options.random_range = pair(1.0, 10.0);
    auto experiment = simulate(*system, theta, options);
    CHECK_FALSE(experiment.complete);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::failed);
    CHECK(experiment.events[0].status == models::FlowStatus::step_budget);
    CHECK_THAT(experiment.message, ContainsSubstring("step budget"));

    options.plan = SamplePlan{0.01, 500, 0};
    experiment = simulate(*system, theta, options);
    CHECK_FALSE(experiment.complete);
    CHECK(experiment.series.size() < 500);
    CHECK_THAT(experiment.message, ContainsSubstring("step budget"));
}

TEST_CASE("samples follow the closed form of a small undamped swing", "[orbits]") {
    // phi'' = -w0sq sin(phi) at amplitude 1e-5: the cosine's relative error is amplitude^2 / 16 per radian of phase,
    // 1e-5 * 6e-12 * 30 rad = 2e-15 rad, far below the integration tolerance of 1e-12 over 9000 samples.
    const auto system = models::make_system("free_pendulum");
    Eigen::VectorXd theta = Eigen::VectorXd::Zero(5);
    theta[0] = 36.0;   // w0sq
    theta[4] = 0.125;  // offset of the encoder
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.001, 5000, 100};  // more than one chunk
    options.initial = pair(1e-5, 0.0);
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.complete);
    const Segment& segment = experiment.series.segments.at(0);
    REQUIRE(segment.values.cols() == 5000);
    CHECK(segment.times[0] == 0.1);
    for (const Eigen::Index k : {0, 1, 4095, 4096, 4999}) {
        const double t = 0.1 + 0.001 * static_cast<double>(k);
        CHECK_THAT(segment.times[k], WithinAbs(t, 1e-12));
        CHECK_THAT(segment.values(0, k), WithinAbs(0.125 + 1e-5 * std::cos(6.0 * t), 1e-10));
        CHECK_THAT(segment.values(1, k), WithinAbs(-6e-5 * std::sin(6.0 * t), 1e-9));
    }
}

TEST_CASE("a free pendulum with dry friction is reported at rest", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    Eigen::VectorXd theta = Eigen::VectorXd::Zero(5);
    theta[0] = 36.0;
    theta[1] = 5.0;
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.01, 1000, 0};
    options.initial = pair(1.0, 0.0);
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::at_rest);
    const auto first = static_cast<Eigen::Index>(experiment.events[0].section);
    const auto& values = experiment.series.segments[0].values;
    CHECK(values(1, first) == 0.0);
    CHECK(values(1, first - 1) != 0.0);
}

TEST_CASE("errors of readings have their sd and their correlation", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    Eigen::VectorXd theta = Eigen::VectorXd::Zero(5);
    theta[0] = 36.0;
    VirtualExperimentOptions options;
    constexpr Eigen::Index count = 20000;
    options.plan = SamplePlan{0.01, static_cast<std::size_t>(count), 0};
    options.initial = pair(1.0, 0.0);
    const auto clean = simulate(*system, theta, options).series.segments[0].values;

    options.noise = pair(0.02, 0.3);
    Eigen::MatrixXd error = simulate(*system, theta, options).series.segments[0].values - clean;
    // Standard error of an estimated variance: sqrt(2 / count) relative; five of them.
    const double five = 5.0 * std::sqrt(2.0 / count);
    CHECK_THAT(error.row(0).squaredNorm() / count, WithinRel(0.02 * 0.02, five));
    CHECK_THAT(error.row(1).squaredNorm() / count, WithinRel(0.3 * 0.3, five));
    CHECK(std::abs(error.row(0).dot(error.row(1)) / count) < 5.0 * 0.02 * 0.3 / std::sqrt(count));

    // Angle and difference share a reading: Cov = q [[1, -1/d], [-1/d, 2/d^2]] (mathematics.md, "Instrument").
    options.sensor = {models::Sensor::Type::angle_difference, 0, 1, 0.015, 0.0, models::Sensor::Rounding::none};
    options.noise = pair(0.0, 0.0);
    const auto smooth = simulate(*system, theta, options).series.segments[0].values;
    options.noise = pair(0.02, 0.0);
    error = simulate(*system, theta, options).series.segments[0].values - smooth;
    const double q = 0.02 * 0.02;
    CHECK_THAT(error.row(0).squaredNorm() / count, WithinRel(q, five));
    CHECK_THAT(error.row(1).squaredNorm() / count, WithinRel(2.0 * q / (0.015 * 0.015), five));
    // Var(x y) = (1 + rho^2) var var, rho^2 = 1/2: relative to the covariance sqrt(3 / count).
    CHECK_THAT(error.row(0).dot(error.row(1)) / count, WithinRel(-q / 0.015, 5.0 * std::sqrt(3.0 / count)));
}

TEST_CASE("readings are rounded to the encoder's steps after the noise", "[orbits]") {
    const auto system = models::make_system("free_pendulum");
    Eigen::VectorXd theta = Eigen::VectorXd::Zero(5);
    theta[0] = 36.0;
    const double step = 2.0 * pi / 4096.0;
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.01, 500, 0};
    options.initial = pair(1.0, 0.0);
    options.noise = pair(0.01, 0.0);
    options.sensor = {models::Sensor::Type::angle_difference, 0, 1, 0.015, step, models::Sensor::Rounding::nearest};
    const auto values = simulate(*system, theta, options).series.segments[0].values;
    for (Eigen::Index k = 0; k < values.cols(); ++k) {
        const double steps = values(0, k) / step;
        const double difference = values(1, k) * 0.015 / step;
        // Multiples up to rounding: 1000 steps carry 1e-13 of a step.
        REQUIRE_THAT(steps, WithinAbs(std::round(steps), 1e-10));
        REQUIRE_THAT(difference, WithinAbs(std::round(difference), 1e-10));
    }
    options.sensor.rounding = models::Sensor::Rounding::none;
    const auto free = simulate(*system, theta, options).series.segments[0].values;
    CHECK((free.row(0) - values.row(0)).cwiseAbs().maxCoeff() <= 0.5 * step * (1.0 + 1e-9));
    CHECK((free.row(0) - values.row(0)).cwiseAbs().maxCoeff() > 0.4 * step);
}

TEST_CASE("experiments that cannot be meant are refused", "[orbits]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto swing = models::make_system("free_pendulum");
    const auto theta = pendulum_parameters(*pendulum, 9.81, 0.0);
    const auto refused = [&](auto change, const std::string& rule) {
        VirtualExperimentOptions options;
        options.plan = SectionPlan{10, 0};
        change(options);
        CAPTURE(rule);
        CHECK_THROWS_AS(simulate(*pendulum, theta, options), std::invalid_argument);
        CHECK_THROWS_WITH(simulate(*pendulum, theta, options), ContainsSubstring(rule));
    };
    using Options = VirtualExperimentOptions;
    refused([](Options& o) { o.plan = SectionPlan{0, 0}; }, "sections is 0, must be > 0");
    refused([](Options& o) { o.plan = SamplePlan{0.0, 10, 0}; }, "sampling step is 0 s, must be > 0");
    refused([](Options& o) { o.plan = SamplePlan{std::nan(""), 10, 0}; }, "must be > 0");
    refused([](Options& o) { o.plan = SamplePlan{0.1, 0, 0}; }, "count of samples is 0");
    refused([](Options& o) { o.trajectories = 0; }, "trajectories is 0");
    refused([](Options& o) { o.initial = Eigen::MatrixXd::Zero(2, 3); }, "shape (2, 3), must be (2, 1)");
    refused([](Options& o) { o.initial = pair(0.0, std::nan("")); }, "must be finite");
    refused([](Options& o) { o.noise = pair(0.0, -1.0); }, "noise of phi_dot is -1, must be >= 0");
    refused([](Options& o) { o.noise = Eigen::VectorXd::Zero(3); }, "noise has 3 entries");
    refused([](Options& o) { o.random_range = pair(1.0, 0.0); }, "random range of phi_dot is 0");
    refused([](Options& o) { o.phase = std::nan(""); }, "phase must be a finite number");
    refused(
        [](Options& o) {
            o.sensor = {models::Sensor::Type::angle_difference, 0, 1, 0.015, 0.0, models::Sensor::Rounding::none};
            o.noise = pair(0.0, 1.0);
        },
        "noise of phi_dot must be 0");
    VirtualExperimentOptions options;
    options.plan = SectionPlan{10, 0};
    CHECK_THROWS_WITH(simulate(*swing, swing->default_parameters(), options), ContainsSubstring("is not forced"));
}

}  // namespace virtual_experiment_test
