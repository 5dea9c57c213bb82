#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/simulation/section_record.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace section_record_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

models::Section plane(std::size_t dimension, std::size_t coordinate, double offset, int direction) {
    return {Eigen::VectorXd::Unit(static_cast<Eigen::Index>(dimension), static_cast<Eigen::Index>(coordinate)), offset,
            direction};
}

Eigen::VectorXd changed(const models::System& system, std::string_view name, double value) {
    Eigen::VectorXd theta = system.default_parameters();
    theta[system.parameter_index(name)] = value;
    return theta;
}

std::size_t count_of(const VirtualExperiment& experiment, TrajectoryEvent::Kind kind) {
    std::size_t count = 0;
    for (const TrajectoryEvent& event : experiment.events)
        if (event.kind == kind) ++count;
    return count;
}

}  // namespace

TEST_CASE("crossings of a plane are recorded with their times", "[orbits]") {
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    VirtualExperimentOptions options;
    options.plan = SectionPlan{61, 20, plane(3, 2, 27.0, -1), 10.0};
    options.trajectories = 2;
    options.initial = (Eigen::MatrixXd(3, 2) << 1.0, -3.0, 2.0, 1.0, 20.0, 15.0).finished();
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.complete);
    CHECK(experiment.events.empty());
    CHECK(experiment.series.sampling == Series::Sampling::section);
    REQUIRE(experiment.series.segments.size() == 2);
    for (std::size_t s = 0; s < 2; ++s) {
        const Segment& segment = experiment.series.segments[s];
        const Eigen::Index count = s == 0 ? 31 : 30;
        REQUIRE(segment.values.cols() == count);
        REQUIRE(segment.times.size() == count);
        // The start is no crossing: the transient takes the first twenty.
        const auto reference =
            system->crossing_ensemble(options.initial.col(static_cast<Eigen::Index>(s)), plane(3, 2, 27.0, -1),
                                      20 + static_cast<std::size_t>(count), 10.0, theta);
        CHECK(segment.values == reference.sections[0].rightCols(count));
        CHECK(segment.times == reference.times[0].tail(count));
        CHECK((segment.values.row(2).array() - 27.0).abs().maxCoeff() < 1e-13);
    }
    options.plan = SectionPlan{1, 0, plane(3, 2, 27.0, -1), 10.0};
    options.trajectories = 1;
    options.initial = options.initial.leftCols(1).eval();
    const auto first = simulate(*system, theta, options);
    CHECK_THAT(first.series.segments[0].values(2, 0), WithinRel(27.0, 1e-14));
}

TEST_CASE("a long record of crossings goes on where its pieces meet", "[orbits]") {
    // More crossings than one call of the ensemble delivers; each follows from the one before after the time between.
    const auto system = models::make_system("rossler");
    const Eigen::VectorXd theta = system->default_parameters();
    VirtualExperimentOptions options;
    options.plan = SectionPlan{2100, 0, plane(3, 0, 0.0, -1)};
    options.initial = Eigen::Vector3d(1.0, -5.0, 0.1);
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.complete);
    const Segment& segment = experiment.series.segments.at(0);
    REQUIRE(segment.times.size() == 2100);
    const Eigen::VectorXd between = segment.times.tail(2099) - segment.times.head(2099);
    // One turn takes about 5.9 s.
    CHECK(between.minCoeff() > 5.0);
    CHECK(between.maxCoeff() < 7.0);
    for (Eigen::Index k = 1020; k < 1030; ++k) {
        const std::array<double, 1> duration{between[k]};
        const auto next = system->flow(segment.values.col(k), 0.0, duration, theta, models::Clock::time);
        // Times near 6e3 s round by 9e-13 s in every one of a hundred steps; speeds are about ten. Measured 2.2e-10.
        CHECK((next.states.col(0) - segment.values.col(k + 1)).norm() < 2e-9);
    }
}

TEST_CASE("random starts of an autonomous flow find the attractor", "[orbits]") {
    for (const char* name : {"lorenz", "rossler"}) {
        CAPTURE(name);
        const auto system = models::make_system(name);
        const bool lorenz = system->name() == "lorenz";
        const Eigen::VectorXd theta = system->default_parameters();
        VirtualExperimentOptions options;
        options.plan = SectionPlan{400, 50, lorenz ? plane(3, 2, 27.0, -1) : plane(3, 0, 0.0, -1)};
        options.trajectories = 4;
        options.seed = 3;
        const auto experiment = simulate(*system, theta, options);
        REQUIRE(experiment.complete);
        CHECK(experiment.series.size() == 400);
        // Lorenz: |x| < 20 on the attractor, falling through z = 27. Roessler: y and z of the returns to x = 0.
        for (const Segment& segment : experiment.series.segments) {
            CHECK(segment.values.row(lorenz ? 0 : 1).cwiseAbs().maxCoeff() < (lorenz ? 20.0 : 12.0));
            CHECK(segment.values.allFinite());
        }
        // Trajectories that explode are told by name, and followed by a new start.
        std::size_t failed = 0;
        for (const TrajectoryEvent& event : experiment.events)
            if (event.kind == TrajectoryEvent::Kind::failed) {
                ++failed;
                CHECK(event.status != models::FlowStatus::ok);
            }
        CHECK(failed == count_of(experiment, TrajectoryEvent::Kind::restarted));
        CHECK((lorenz ? failed == 0 : failed > 0));

        const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
        const auto again = simulate(*system, theta, options);
        REQUIRE(again.series.segments.size() == experiment.series.segments.size());
        for (std::size_t s = 0; s < again.series.segments.size(); ++s) {
            CHECK(again.series.segments[s].values == experiment.series.segments[s].values);
            CHECK(again.series.segments[s].times == experiment.series.segments[s].times);
        }
    }
}

TEST_CASE("how long a return may take is found from a few", "[orbits]") {
    const auto rossler = models::make_system("rossler");
    const Eigen::MatrixXd starts = (Eigen::MatrixXd(3, 2) << 1.0, 0.5, -5.0, -4.0, 0.1, 0.2).finished();
    const auto probe =
        probe_returns(*rossler, rossler->default_parameters(), plane(3, 0, 0.0, -1), starts, models::FlowOptions{});
    // A hundred turns of about 5.9 s; the attractor reaches x = 11.4, y = -10.8, z = 22.8.
    CHECK_THAT(probe.longest_return, WithinRel(590.0, 0.03));
    CHECK_THAT(probe.range[0], WithinAbs(11.0, 1.0));
    CHECK_THAT(probe.range[1], WithinAbs(10.5, 1.0));
    CHECK_THAT(probe.range[2], WithinAbs(20.0, 4.0));
    // A plane that is never met: the longest time tried, and the starts themselves.
    const auto none =
        probe_returns(*rossler, rossler->default_parameters(), plane(3, 0, 500.0, -1), starts, models::FlowOptions{});
    CHECK(none.longest_return > 0.0);
    CHECK(none.range == starts.cwiseAbs().rowwise().maxCoeff());
}

TEST_CASE("stable cycles of an autonomous flow capture its returns", "[orbits][reference]") {
    // Period doubling of the Roessler equations with a = b = 0.2: c = 2.5, 3.5 and 4 have stable cycles of 1, 2 and 4
    // turns (H.-O. Peitgen, H. Juergens, D. Saupe, Chaos and Fractals, section 12.3).
    const auto system = models::make_system("rossler");
    for (const auto& [c, turns] : {std::pair{2.5, 1}, std::pair{3.5, 2}, std::pair{4.0, 4}}) {
        CAPTURE(c);
        VirtualExperimentOptions options;
        options.plan = SectionPlan{3000, 0, plane(3, 0, 0.0, -1)};
        options.initial = Eigen::Vector3d(1.0, -3.0, 0.1);
        options.restart = Restart::never;
        const auto experiment = simulate(*system, changed(*system, "c", c), options);
        CHECK(experiment.complete);
        REQUIRE(experiment.events.size() == 1);
        CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::captured);
        CHECK(experiment.events[0].period == turns);
        // From the section named on, the record repeats; before it does not.
        const auto& values = experiment.series.segments[0].values;
        const auto first = static_cast<Eigen::Index>(experiment.events[0].section) - 1;  // crossing 1 is column 0
        REQUIRE(first > 0);
        const double range = values.row(1).cwiseAbs().maxCoeff();
        CHECK((values.col(first + turns) - values.col(first)).norm() < 1e-8 * range);
        CHECK((values.col(first - 1 + turns) - values.col(first - 1)).norm() > 1e-10 * range);
    }
    // Restarted trajectories all end there: given up.
    VirtualExperimentOptions options;
    options.plan = SectionPlan{100, 900, plane(3, 0, 0.0, -1)};
    options.random_range = Eigen::Vector3d(3.0, 3.0, 0.5);
    const auto given_up = simulate(*system, changed(*system, "c", 2.5), options);
    CHECK_FALSE(given_up.complete);
    CHECK_THAT(given_up.message, ContainsSubstring("20 times in a row") &&
                                     ContainsSubstring("the last time it was captured by an orbit of period"));
}

TEST_CASE("a section that is never reached is said to be the reason", "[orbits]") {
    // z of the Lorenz attractor stays positive.
    const auto system = models::make_system("lorenz");
    VirtualExperimentOptions options;
    options.plan = SectionPlan{10, 0, plane(3, 2, -50.0, -1), 20.0};
    const auto experiment = simulate(*system, system->default_parameters(), options);
    CHECK_FALSE(experiment.complete);
    CHECK(experiment.series.size() == 0);
    CHECK_THAT(experiment.message, ContainsSubstring("20 times in a row") &&
                                       ContainsSubstring("the last time it could not be continued (") &&
                                       ContainsSubstring("the section was not reached"));
}

TEST_CASE("a flow that settles on an equilibrium is at rest", "[orbits]") {
    // rho = 10: all trajectories of the Lorenz equations end on one of the rolls, z = rho - 1 = 9.
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd theta = changed(*system, "rho", 10.0);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{100, 0, plane(3, 2, 9.5, -1), 200.0};
    options.initial = Eigen::Vector3d(1.0, 2.0, 20.0);
    options.restart = Restart::never;
    auto experiment = simulate(*system, theta, options);
    CHECK_FALSE(experiment.complete);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::at_rest);
    CHECK(experiment.events[0].status == models::FlowStatus::no_crossing);
    CHECK(experiment.events[0].section == experiment.series.size());
    CHECK(experiment.series.size() > 0);
    CHECK_THAT(experiment.message, ContainsSubstring("the section was not reached"));

    options.restart = Restart::when_captured_or_at_rest;
    options.plan = SectionPlan{100, 50, plane(3, 2, 9.5, -1), 200.0};
    experiment = simulate(*system, theta, options);
    CHECK_FALSE(experiment.complete);
    CHECK(experiment.series.size() == 0);
    CHECK(count_of(experiment, TrajectoryEvent::Kind::at_rest) == 20);
    CHECK(count_of(experiment, TrajectoryEvent::Kind::restarted) == 19);

    // A time too short for a return is no rest.
    options.plan = SectionPlan{100, 50, plane(3, 2, 9.5, -1), 0.01};
    options.restart = Restart::never;
    experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::failed);
    CHECK(experiment.events[0].status == models::FlowStatus::no_crossing);

    // The rolls lie on the plane z = rho - 1: returns shrink until they repeat.
    options.plan = SectionPlan{2000, 0, plane(3, 2, 9.0, -1), 200.0};
    experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 1);
    CHECK(experiment.events[0].kind != TrajectoryEvent::Kind::restarted);
    CHECK(experiment.events[0].section < 300);
}

TEST_CASE("chaos beside stable equilibria is recorded from the starts that stay in it", "[orbits]") {
    // 24.06 < rho < 24.74: the rolls are stable and the strange attractor exists (C. Sparrow, The Lorenz Equations).
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd theta = changed(*system, "rho", 24.3);
    VirtualExperimentOptions options;
    // Not the rolls' own z = 23.3, which decaying turns around them would meet for ever.
    options.plan = SectionPlan{2000, 500, plane(3, 2, 20.0, -1)};
    options.trajectories = 8;
    options.seed = 1;
    const auto experiment = simulate(*system, theta, options);
    CHECK(experiment.complete);
    CHECK(experiment.series.size() == 2000);
    for (const Segment& segment : experiment.series.segments)
        CHECK((segment.values.row(0).minCoeff() < 0.0 || segment.values.cols() < 50));
}

TEST_CASE("maps are recorded by their iterates, captured and restarted like flows", "[orbits][reference]") {
    const auto logistic = models::make_system("logistic");
    VirtualExperimentOptions options;
    options.initial = Eigen::VectorXd::Constant(1, 0.3);
    options.restart = Restart::never;
    // Stable cycles: r = 3.2 period 2, 3.5 period 4, 3.83 period 3 (the window opens at 1 + sqrt 8).
    for (const auto& [r, period] : {std::pair{3.2, 2}, std::pair{3.5, 4}, std::pair{3.83, 3}}) {
        CAPTURE(r);
        options.plan = SectionPlan{2000, 0};
        const auto experiment = simulate(*logistic, changed(*logistic, "r", r), options);
        CHECK(experiment.complete);
        REQUIRE(experiment.events.size() == 1);
        CHECK(experiment.events[0].kind == TrajectoryEvent::Kind::captured);
        CHECK(experiment.events[0].period == period);
        const auto& segment = experiment.series.segments[0];
        CHECK(segment.times.size() == 0);
        for (Eigen::Index k = 0; k < 20; ++k) {
            const double x = segment.values(0, k);
            CHECK_THAT(segment.values(0, k + 1), WithinRel(r * x * (1.0 - x), 1e-14));
        }
    }
    // Half of the starts in [-1, 1] are negative and leave for minus infinity.
    options.initial.resize(0, 0);
    options.restart = Restart::when_captured_or_at_rest;
    options.trajectories = 8;
    options.plan = SectionPlan{1000, 100};
    const auto experiment = simulate(*logistic, changed(*logistic, "r", 3.9), options);
    CHECK(experiment.complete);
    CHECK(experiment.series.size() == 1000);
    CHECK(count_of(experiment, TrajectoryEvent::Kind::failed) > 0);
    for (const Segment& segment : experiment.series.segments) {
        CHECK(segment.values.minCoeff() > 0.0);
        CHECK(segment.values.maxCoeff() < 1.0);
    }
    const auto henon = models::make_system("henon");
    options.plan = SectionPlan{20000, 100};
    const auto chaos = simulate(*henon, henon->default_parameters(), options);
    CHECK(chaos.complete);
    CHECK(chaos.series.size() == 20000);
    for (const Segment& segment : chaos.series.segments)
        CHECK(segment.values.row(0).cwiseAbs().maxCoeff() < 1.3);
}

// mathematics.md, section 6: with g = 9.8348933 a mirror pair of stable orbits of period 10 coexists with the chaos,
// one point being (1.45386491048, 13.65237565711).
TEST_CASE("capture by the stable period-10 orbit is told with period and section", "[orbits][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    const auto set = [&](std::string_view name, double value) { theta[system->parameter_index(name)] = value; };
    set("m", 0.0858);
    set("l", 0.317);
    set("k1", 0.0);
    set("k2", 4.85e-4);
    set("k3", 1.90e-4);
    set("g", 9.8348933);
    set("A", 0.131);
    set("omega", 9.09);
    set("epsilon", 0.173);
    const Eigen::Vector2d point(1.45386491048, 13.65237565711);
    VirtualExperimentOptions options;
    options.plan = SectionPlan{4000, 0};
    options.trajectories = 2;
    // Beside the point and beside its mirror image, in the basins.
    options.initial = Eigen::MatrixXd(2, 2);
    options.initial.col(0) = point + Eigen::Vector2d(1e-4, -1e-4);
    options.initial.col(1) = -options.initial.col(0);
    options.restart = Restart::never;
    const auto experiment = simulate(*system, theta, options);
    REQUIRE(experiment.events.size() == 2);
    for (std::size_t i = 0; i < 2; ++i) {
        const TrajectoryEvent& event = experiment.events[i];
        CHECK(event.kind == TrajectoryEvent::Kind::captured);
        CHECK(event.trajectory == i);
        CHECK(event.period == 10);
        const orbits::Readings& values = experiment.series.segments[i].values;
        const auto first = static_cast<Eigen::Index>(event.section);
        REQUIRE(first > 10);
        REQUIRE(first < 1000);
        // It repeats from there on within 1e-9 of the range (2 pi, 30 rad/s), and one section earlier it does not. The
        // range is the attractor's as 16 trajectories found it, 29.3 rad/s at most.
        const auto moved = [&](Eigen::Index k) {
            const Eigen::Vector2d difference = values.col(k + 10) - values.col(k);
            return std::max(std::abs(models::wrapped(difference[0])) / (2.0 * std::numbers::pi),
                            std::abs(difference[1]) / 29.3);
        };
        for (Eigen::Index k = first; k + 10 < values.cols(); ++k)
            REQUIRE(moved(k) <= 1e-9);
        CHECK(moved(first - 1) > 0.8e-9);
        double nearest = 1.0;
        for (Eigen::Index k = 0; k < 10; ++k)
            nearest = std::min(nearest, ((i == 0 ? 1.0 : -1.0) * values.col(values.cols() - 1 - k) - point).norm());
        // The integrator's error of the orbit, 1.7e-9 at tolerance 1e-12: ten times that.
        CHECK(nearest < 1.7e-8);
    }
}

TEST_CASE("sections by a plane that cannot be meant are refused", "[orbits]") {
    const auto lorenz = models::make_system("lorenz");
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto henon = models::make_system("henon");
    const auto refused = [](const models::System& system, const SectionPlan& plan, const char* rule) {
        CAPTURE(rule);
        VirtualExperimentOptions options;
        options.plan = plan;
        CHECK_THROWS_AS(simulate(system, system.default_parameters(), options), std::invalid_argument);
        CHECK_THROWS_WITH(simulate(system, system.default_parameters(), options), ContainsSubstring(rule));
    };
    const auto z27 = plane(3, 2, 27.0, -1);
    refused(*lorenz, {10, 0}, "model lorenz is not forced and has no sections at a phase; name a plane");
    refused(*pendulum, {10, 0, plane(2, 0, 0.0, 1)}, "is not autonomous: its sections are at a phase of the forcing");
    refused(*henon, {10, 0, plane(2, 0, 0.0, 1)}, "is not autonomous: its sections are its iterates");
    refused(*lorenz, {10, 0, plane(2, 0, 0.0, 1)}, "normal of the section has 2 entries, must have 3");
    refused(*lorenz, {10, 0, plane(3, 0, 0.0, 0)}, "direction of the section is 0");
    refused(*lorenz, {10, 0, z27, -1.0}, "longest return time is -1 s, must be > 0");
    refused(*lorenz, {10, 0, z27, std::numeric_limits<double>::quiet_NaN()}, "longest return time is nan s");
}

}  // namespace section_record_test
