#include "periodic/solution/collocation.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "periodic/discretisation/collocation_mesh.hpp"
#include "periodic/discretisation/gauss_method.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace collocation_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::CollocationOptions;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::solve_collocation;
using periodic::StartingSolution;

namespace {

constexpr double pi = std::numbers::pi;

StartingSolution at_points(const MatrixXd& points) {
    StartingSolution start;
    start.points = points;
    return start;
}

}  // namespace

TEST_CASE("Gauss's methods of one, two and three stages are those of the tables", "[periodic]") {
    const auto one = periodic::gauss_method(1);
    CHECK(one.nodes(0) == 0.5);
    CHECK(one.matrix(0, 0) == 0.5);
    const auto two = periodic::gauss_method(2);
    const double r = std::sqrt(3.0) / 6.0;
    CHECK((two.nodes - Eigen::Vector2d(0.5 - r, 0.5 + r)).norm() < 1e-15);
    CHECK((two.matrix - (MatrixXd(2, 2) << 0.25, 0.25 - r, 0.25 + r, 0.25).finished()).norm() < 1e-15);
    const auto three = periodic::gauss_method(3);
    CHECK((three.weights - Eigen::Vector3d(5.0, 8.0, 5.0) / 18.0).norm() < 1e-15);
    for (const int m : {1, 2, 5, 10}) {
        CAPTURE(m);
        const auto method = periodic::gauss_method(m);
        for (int power = 0; power < 2 * m; ++power) {
            const double integral = method.weights.dot(method.nodes.array().pow(power).matrix());
            CHECK_THAT(integral, tests::WithinAbs(1.0 / (power + 1), 1e-15));
        }
        // u^(m-1) / (m-1)! has the (m-1)-st derivative 1.
        CHECK_THAT(method.highest_derivatives().dot(method.nodes.array().pow(m - 1).matrix()) / std::tgamma(m),
                   tests::WithinAbs(1.0, 1e-8));
    }
    CHECK_THROWS_WITH(periodic::gauss_method(0), tests::ContainsSubstring("stages is 0"));
    CHECK_THROWS_WITH(periodic::gauss_method(11), tests::ContainsSubstring("stages is 11"));
}

TEST_CASE("collocation has order 2 m at mesh points", "[periodic]") {
    const auto system = models::make_system("driven_pendulum");
    const VectorXd theta = system->default_parameters();
    // tests/reference/driven_pendulum_orbits.json, the first cycle.
    const Eigen::Vector2d exact(-1.199766773168538552, 0.448485514487017406);
    const double multiplier = -9.43054755064114;
    for (const int m : {1, 2, 3}) {
        CAPTURE(m);
        std::array<double, 3> point_error{};
        std::array<double, 3> multiplier_error{};
        for (std::size_t r = 0; r < 3; ++r) {
            CollocationOptions options;
            options.stages = m;
            options.intervals = (m == 1 ? 100 : 20) << r;
            options.mesh_updates = options.halvings = 0;
            const PeriodicOrbit orbit =
                solve_collocation(*system, theta, at_points((exact.array() + 1e-3).matrix()), {}, options);
            REQUIRE(orbit.status == OrbitStatus::converged);
            CHECK(orbit.rotation == std::vector<int>{-1});
            CHECK(std::isnan(orbit.discretisation_error));
            point_error[r] = (orbit.points - exact).norm();
            multiplier_error[r] = std::abs(orbit.multipliers[0].real() / multiplier - 1.0);
        }
        // Half the step: 4^m times smaller, but for higher powers of the step.
        CHECK_THAT(std::log2(point_error[1] / point_error[2]), tests::WithinAbs(2.0 * m, 0.2 * m));
        CHECK_THAT(std::log2(multiplier_error[1] / multiplier_error[2]), tests::WithinAbs(2.0 * m, 0.2 * m));
    }
}

TEST_CASE("collocation reaches the accuracy it is asked for", "[periodic][reference]") {
    const auto system = models::make_system("driven_pendulum");
    const VectorXd theta = system->default_parameters();
    const Eigen::Vector2d exact(-1.199766773168538552, 0.448485514487017406);
    const PeriodicOrbit orbit =
        solve_collocation(*system, theta, at_points((exact.array() + 1e-3).matrix()), std::vector<Index>{0, 1, 2});
    REQUIRE(orbit.status == OrbitStatus::converged);
    CHECK(orbit.discretisation_error < 1e-10);
    // Measured 1.6e-13, 5e-14 and 6e-13, times ten. The product of the multipliers is exp(-gamma T).
    CHECK((orbit.points - exact).cwiseAbs().maxCoeff() < 1.6e-12);
    CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(-9.43054755064114, 5e-13));
    CHECK_THAT(orbit.multipliers[1].real(), tests::WithinRel(std::exp(-0.6 * pi) / -9.43054755064114, 6e-12));
    const PeriodicOrbit shot =
        periodic::solve_multiple_shooting(*system, theta, 0.0, exact, {}, std::vector<Index>{0, 1, 2});
    REQUIRE(shot.status == OrbitStatus::converged);
    // Measured 3.4e-13 and 4e-13, times ten.
    CHECK((orbit.sensitivities - shot.sensitivities).cwiseAbs().maxCoeff() <
          3.4e-12 * shot.sensitivities.cwiseAbs().maxCoeff());
    CHECK(orbit.jacobians.size() == 1);
    CHECK((orbit.jacobians[0] - shot.jacobians[0]).cwiseAbs().maxCoeff() < 4e-12 * shot.jacobians[0].norm());
}

TEST_CASE("collocation: Hopf's cycle with unknown period", "[periodic]") {
    const tests::HopfNormalForm system;
    StartingSolution start = at_points(Eigen::Vector2d(1.1, 0.2));
    start.time = 6.2;
    CollocationOptions options;
    options.solver.maximum_distance = 1.0;
    options.accuracy = 1e-12;
    const std::vector<Index> free{1, 0};
    const PeriodicOrbit orbit = solve_collocation(system, system.default_parameters(), start, free, options);
    REQUIRE(orbit.status == OrbitStatus::converged);
    // Measured: T exact, 3.2e-13 of the multiplier, 2e-16 of the trivial one, 3e-15 of the rest; times ten.
    CHECK_THAT(orbit.time, tests::WithinAbs(2.0 * pi, 1e-14));
    REQUIRE(orbit.multipliers.size() == 1);
    CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::exp(-4.0 * pi), 3.2e-12));
    CHECK(std::abs(orbit.trivial_multiplier - 1.0) < 1e-14);
    CHECK_THAT(orbit.points.col(0).norm(), tests::WithinAbs(1.0, 3e-14));
    CHECK_THAT(orbit.time_sensitivities(0), tests::WithinAbs(-2.0 * pi, 3e-14));
    CHECK_THAT(orbit.time_sensitivities(1), tests::WithinAbs(0.0, 3e-14));
    const Eigen::Vector2d out = orbit.points.col(0);
    CHECK_THAT(out.dot(orbit.sensitivities.block<2, 1>(0, 1)), tests::WithinAbs(0.5, 3e-14));
}

TEST_CASE("collocation: orbits of Roessler, whose spikes need an adaptive mesh", "[periodic][reference]") {
    const auto system = models::make_system("rossler");
    const VectorXd theta = system->default_parameters();
    const tests::FlowOrbits table = tests::read_flow_orbits("rossler");
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}, std::size_t{3}}) {
        const tests::FlowOrbit& reference = table.orbits[i];
        CAPTURE(reference.code);
        StartingSolution start;
        start.section = table.section;
        start.points = system->crossings(reference.point, table.section, reference.code.size(), 100.0, theta).states;
        start.points.bottomRows(2).array() += 1e-3;
        CollocationOptions options;
        options.solver.scale = Eigen::Vector3d(20.0, 20.0, 25.0);
        const PeriodicOrbit orbit = solve_collocation(*system, theta, start, {}, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK_THAT(orbit.time, tests::WithinRel(reference.time, 1e-9));
        CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(reference.unstable_multiplier, 1e-8));
        // Twenty intervals per turn, equidistant and moved.
        std::array<double, 2> error{};
        for (const int updates : {0, 3}) {
            options.mesh_updates = updates;
            options.halvings = 0;
            const PeriodicOrbit coarse = solve_collocation(*system, theta, start, {}, options);
            REQUIRE(coarse.status == OrbitStatus::converged);
            error[updates > 0 ? 1 : 0] = std::abs(coarse.time / reference.time - 1.0);
        }
        // 50 times less where z has spikes of different height (011), 5 times (01), no gain on one turn (1).
        CHECK(error[1] < (reference.code == "011" ? 0.1 : 1.1) * error[0]);
    }
}

TEST_CASE("a mesh follows the error and halves its intervals", "[periodic]") {
    CHECK(periodic::halved({0.0, 0.5}) == std::vector<double>{0.0, 0.25, 0.5, 0.75});
}

TEST_CASE("collocation refuses what makes no sense", "[periodic]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto henon = models::make_system("henon");
    VectorXd theta = pendulum->default_parameters();
    const StartingSolution start = at_points(Eigen::Vector2d(3.0, 6.4));
    CHECK_THROWS_WITH(solve_collocation(*henon, henon->default_parameters(), start, {}),
                      tests::ContainsSubstring("a map"));
    const auto refused = [&](const CollocationOptions& options, const char* rule) {
        CHECK_THROWS_WITH(solve_collocation(*pendulum, theta, start, {}, options), tests::ContainsSubstring(rule));
    };
    refused({.stages = 0}, "stages is 0");
    refused({.intervals = 1}, "intervals is 1");
    refused({.mesh_updates = -1}, "mesh_updates");
    refused({.accuracy = 0.0}, "accuracy");
    refused({.halvings = -1}, "halvings");
    theta(pendulum->parameter_index("k1")) = 1e-3;
    refused({}, "not smooth");
}

}  // namespace collocation_test
