#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"

namespace autonomous_orbits_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::ShootingOptions;
using periodic::solve_multiple_shooting;
using periodic::StartingSolution;

namespace {

constexpr double pi = std::numbers::pi;

/// A state and a period.
StartingSolution timed(const VectorXd& state, double time) {
    StartingSolution start;
    start.points = state;
    start.time = time;
    return start;
}

}  // namespace

TEST_CASE("Hopf's cycle: period, multipliers and derivatives in closed form", "[periodic]") {
    const tests::HopfNormalForm system;
    const VectorXd theta = system.default_parameters();
    const std::vector<Index> free{1, 0};
    for (const double growth : {1e3, 1.5}) {  // one node, and several
        CAPTURE(growth);
        const PeriodicOrbit orbit = solve_multiple_shooting(system, theta, timed(Eigen::Vector2d(1.2, 0.3), 6.0), free,
                                                            {.maximum_distance = 1.0, .segment_growth = growth});
        REQUIRE(orbit.status == OrbitStatus::converged);
        // Asked for: 1e-12. Measured: T exact, 4.4e-15 (relative) and 1.6e-15 of the multipliers, 2.7e-15 of dT, 5e-16
        // of the other derivatives; times ten.
        CHECK_THAT(orbit.time, tests::WithinAbs(2.0 * pi, 1e-14));
        REQUIRE(orbit.multipliers.size() == 1);
        CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::exp(-4.0 * pi), 5e-14));
        CHECK(std::abs(orbit.trivial_multiplier - 1.0) < 2e-14);
        CHECK((growth > 100.0) == (orbit.points.cols() < 4));
        for (Index j = 0; j < orbit.points.cols(); ++j) {
            CHECK_THAT(orbit.points.col(j).norm(), tests::WithinAbs(1.0, 1e-14));
            // d radius / d mu = 1 / 2; nothing but the point's angle depends on w.
            const Eigen::Vector2d out = orbit.points.col(j);
            CHECK_THAT(out.dot(orbit.sensitivities.block<2, 1>(2 * j, 1)), tests::WithinAbs(0.5, 5e-15));
            CHECK_THAT(out.dot(orbit.sensitivities.block<2, 1>(2 * j, 0)), tests::WithinAbs(0.0, 5e-15));
        }
        CHECK_THAT(orbit.time_sensitivities(0), tests::WithinAbs(-2.0 * pi, 3e-14));
        CHECK_THAT(orbit.time_sensitivities(1), tests::WithinAbs(0.0, 3e-14));
    }
}

TEST_CASE("Hopf's cycle with the integral phase condition", "[periodic]") {
    const tests::HopfNormalForm system;
    const VectorXd theta = system.default_parameters();
    const std::vector<Index> free{1, 0};
    ShootingOptions options;
    options.maximum_distance = 1.0;
    options.phase = periodic::PhaseChoice::integral;
    const PeriodicOrbit orbit =
        solve_multiple_shooting(system, theta, timed(Eigen::Vector2d(1.0, 0.0), 6.0), free, options);
    REQUIRE(orbit.status == OrbitStatus::converged);
    CHECK(orbit.points.cols() == 12);
    CHECK_THAT(orbit.time, tests::WithinAbs(2.0 * pi, 1e-14));
    CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::exp(-4.0 * pi), 5e-14));
    CHECK_THAT(orbit.time_sensitivities(0), tests::WithinAbs(-2.0 * pi, 3e-14));
    // Points at equal shares of T whose mean shift along the orbit does not depend on mu: they move outwards only, by
    // 1 / 2 each, and not at all with w.
    for (Index j = 0; j < 12; ++j) {
        CHECK_THAT(orbit.points.col(j).norm(), tests::WithinAbs(1.0, 1e-14));
        // Up to the 3e-10 (measured, times ten) by which the nodes the condition refers to are off the circle.
        CHECK((orbit.sensitivities.block<2, 1>(2 * j, 1) - 0.5 * orbit.points.col(j)).norm() < 3e-9);
        CHECK(orbit.sensitivities.block<2, 1>(2 * j, 0).norm() < 1e-13);
    }
}

TEST_CASE("orbits of Lorenz and Roessler: 12 digits of T, 9 of the multipliers", "[periodic][reference]") {
    int solved = 0;
    for (const char* name : {"lorenz", "rossler"}) {
        const auto system = models::make_system(name);
        const VectorXd theta = system->default_parameters();
        const tests::FlowOrbits table = tests::read_flow_orbits(name);
        for (const tests::FlowOrbit& reference : table.orbits) {
            CAPTURE(name, reference.code);
            const auto p = static_cast<Index>(reference.code.size());
            // Its crossings by simulation, then 1e-3 off: a measurement would give that.
            const auto crossings =
                system->crossings(reference.point, table.section, reference.code.size(), 100.0, theta);
            REQUIRE(crossings.states.cols() == p);
            StartingSolution start;
            start.section = table.section;
            start.points = crossings.states;
            for (Index j = 0; j < p; ++j)
                for (Index i = 0; i < 3; ++i)
                    if (table.section.normal(i) == 0.0)
                        start.points(i, j) += 1e-3 * std::sin(5.0 * static_cast<double>(j + i) + 1.0);
            ShootingOptions options;
            options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
            const PeriodicOrbit orbit = solve_multiple_shooting(*system, theta, start, {}, options);
            REQUIRE(orbit.status == OrbitStatus::converged);
            REQUIRE(orbit.points.cols() == p);
            // Asked for: 1e-12 and 1e-9. Worst measured 9e-16 (T), 1.5e-13 (points), 6e-14 and 8e-14 (multipliers).
            CHECK_THAT(orbit.time, tests::WithinRel(reference.time, 1e-14));
            // The crossings begin with the first one after the reference point, which is therefore the last one.
            CHECK((orbit.points.col(p - 1) - reference.point).cwiseAbs().maxCoeff() < 2e-12);
            CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(reference.unstable_multiplier, 1e-12));
            CHECK(std::abs(orbit.trivial_multiplier - 1.0) < 1e-12);
            ++solved;
            if (std::string(name) == "lorenz") {
                // Liouville: the product of the multipliers is exp(-(sigma + 1 + beta) T).
                const double product = orbit.multipliers[0].real() * orbit.multipliers[1].real();
                const double expected = std::exp(-(11.0 + 8.0 / 3.0) * reference.time);
                CHECK_THAT(product, tests::WithinRel(expected, 2e-11));  // 1.7e-12 measured
            }
        }
    }
    CHECK(solved == 24);
}

TEST_CASE("crossings and period of an autonomous orbit move as differences of solved orbits do", "[periodic]") {
    const auto system = models::make_system("lorenz");
    const tests::FlowOrbits table = tests::read_flow_orbits("lorenz");
    StartingSolution start;
    start.section = table.section;
    start.points =
        system->crossings(table.orbits[1].point, table.section, 3, 100.0, system->default_parameters()).states;
    ShootingOptions options;
    options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
    const auto solve = [&](const VectorXd& theta, const std::vector<Index>& free) {
        PeriodicOrbit orbit = solve_multiple_shooting(*system, theta, start, free, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        return orbit;
    };
    const VectorXd theta = system->default_parameters();
    const PeriodicOrbit orbit = solve(theta, {0, 1, 2});
    for (Index k = 0; k < 3; ++k) {
        CAPTURE(k);
        // Central differences at h and 2 h, extrapolated; values: the points below each other, then T.
        const auto difference = [&](double h) {
            VectorXd value[2];
            for (int side = 0; side < 2; ++side) {
                VectorXd moved = theta;
                moved(k) += side == 0 ? h : -h;
                const PeriodicOrbit there = solve(moved, {});
                value[side].resize(10);
                value[side] << there.points.reshaped(), there.time;
            }
            return VectorXd((value[0] - value[1]) / (2.0 * h));
        };
        const VectorXd slope = (4.0 * difference(2e-3) - difference(4e-3)) / 3.0;
        VectorXd computed(10);
        computed << orbit.sensitivities.col(k), orbit.time_sensitivities(k);
        // Worst measured 2.4e-12 of the largest; ten times that.
        CHECK((slope - computed).cwiseAbs().maxCoeff() < 2.4e-11 * slope.cwiseAbs().maxCoeff());
        for (Index j = 0; j < 3; ++j)
            CHECK(std::abs(orbit.sensitivities(3 * j + 2, k)) <
                  3e-14);  // z stays on the section: 3e-15 measured, times ten
    }
}

TEST_CASE("an equilibrium is found out", "[periodic]") {
    const auto lorenz = models::make_system("lorenz");
    const VectorXd theta = lorenz->default_parameters();
    const double side = std::sqrt(72.0);
    const Eigen::Vector3d rest(side, side, 27.0);
    SECTION("as the start") {
        const PeriodicOrbit orbit = solve_multiple_shooting(*lorenz, theta, timed(rest, 0.7), {});
        CHECK(orbit.status == OrbitStatus::equilibrium);
        CHECK((orbit.points - rest).norm() < 1e-14);
    }
    SECTION("by Newton, on a section that holds it") {
        StartingSolution start;
        start.points = Eigen::Vector3d(side + 0.1, side - 0.1, 27.0);
        start.section = models::Section{Eigen::Vector3d::UnitZ(), 27.0, 1};
        const PeriodicOrbit orbit = solve_multiple_shooting(*lorenz, theta, start, {});
        CHECK(orbit.status == OrbitStatus::equilibrium);
        REQUIRE(orbit.points.cols() == 1);
        CHECK((orbit.points - rest).norm() < 1e-5);  // told from an orbit of this size, see at_equilibrium
    }
    CHECK(periodic::name(OrbitStatus::equilibrium) == "equilibrium");
}

TEST_CASE("autonomous flows: other ends of the search", "[periodic]") {
    const tests::HopfNormalForm hopf;
    const VectorXd theta = hopf.default_parameters();
    SECTION("the period vanishes where nothing closes") {
        const tests::Drift drift;
        const PeriodicOrbit none =
            solve_multiple_shooting(drift, drift.default_parameters(), timed(Eigen::Vector2d(0.0, 1.0), 2.0), {});
        CHECK(none.status == OrbitStatus::period_vanished);
        CHECK(none.time < 2.0);
        CHECK(periodic::name(none.status) == "period_vanished");
    }
    SECTION("no orbit: everything falls into the origin") {
        const PeriodicOrbit none =
            solve_multiple_shooting(hopf, Eigen::Vector2d(-1.0, 1.0), timed(Eigen::Vector2d(1.0, 0.0), 6.3), {});
        CHECK(none.status != OrbitStatus::converged);
        CHECK(none.status != OrbitStatus::shorter_period);
    }
    SECTION("three times around") {
        const PeriodicOrbit thrice =
            solve_multiple_shooting(hopf, theta, timed(Eigen::Vector2d(1.01, 0.0), 6.0 * pi + 0.01), {});
        CHECK(thrice.status == OrbitStatus::shorter_period);
        CHECK_THAT(thrice.time, tests::WithinAbs(6.0 * pi, 1e-12));
    }
    SECTION("farther away than allowed") {
        const PeriodicOrbit far =
            solve_multiple_shooting(hopf, theta, timed(Eigen::Vector2d(1.2, 0.0), 6.2), {}, {.maximum_distance = 0.05});
        CHECK(far.status == OrbitStatus::other_orbit);
        CHECK(far.distance > 0.05);
    }
    SECTION("no return to the section") {
        const auto lorenz = models::make_system("lorenz");
        StartingSolution start;
        start.points = Eigen::Vector3d(1.0, 1.0, 300.0);
        start.section = models::Section{Eigen::Vector3d::UnitZ(), 300.0, 1};
        const PeriodicOrbit none = solve_multiple_shooting(*lorenz, lorenz->default_parameters(), start, {});
        CHECK(none.status == OrbitStatus::not_simulated);
    }
}

TEST_CASE("autonomous starts that make no sense are refused", "[periodic]") {
    const tests::HopfNormalForm hopf;
    const tests::HenonMap henon;
    const VectorXd theta = hopf.default_parameters();
    const auto refused = [](const models::System& system, const StartingSolution& start, const std::string& rule) {
        CHECK_THROWS_WITH(solve_multiple_shooting(system, system.default_parameters(), start, {}),
                          tests::ContainsSubstring(rule));
    };
    refused(hopf, timed(Eigen::Vector2d(1.0, 0.0), 0.0), "must be > 0");
    refused(hopf, timed(Eigen::Vector2d(1.0, 0.0), -1.0), "must be > 0");
    refused(hopf, timed(Eigen::Vector2d(1.0, 0.0), std::numeric_limits<double>::quiet_NaN()), "must be > 0");
    refused(henon, timed(Eigen::Vector2d(1.0, 0.0), 1.0), "belong to autonomous models");
    StartingSolution two;
    two.points = MatrixXd::Ones(2, 2);
    two.time = 1.0;
    refused(hopf, two, "one state is needed");
}

}  // namespace autonomous_orbits_test
