#include "periodic/solution/finite_difference.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace finite_difference_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::FiniteDifferenceOptions;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::solve_finite_difference;
using periodic::StartingSolution;

namespace {

constexpr double pi = std::numbers::pi;

StartingSolution at_points(const MatrixXd& points) {
    StartingSolution start;
    start.points = points;
    return start;
}

}  // namespace

TEST_CASE("Fey's scheme moves the pendulum's cycle as an independent computation says", "[periodic][reference]") {
    // Shifts of (phi / 2 pi, phi_dot / 29.3), two digits given: half a unit of the second one.
    struct Row {
        int nodes;
        double phi, phi_dot, half_unit_phi, half_unit_phi_dot;
    };
    const std::array table{Row{50, 1.8e-6, 3.2e-5, 0.05e-6, 0.05e-5}, Row{100, 4.4e-7, 8.0e-6, 0.05e-7, 0.05e-6},
                           Row{200, 1.1e-7, 2.0e-6, 0.05e-7, 0.05e-6}, Row{400, 2.7e-8, 5.0e-7, 0.05e-8, 0.05e-7}};
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits orbits = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const tests::ReferenceOrbit& cycle = orbits.orbits.front();
    REQUIRE(std::abs(cycle.points(0, 0) - 2.966784) < 1e-6);
    for (const Row& row : table) {
        CAPTURE(row.nodes);
        FiniteDifferenceOptions options;
        options.nodes = row.nodes;
        options.solver.scale = Eigen::Vector2d(2.0 * pi, 29.3);
        const PeriodicOrbit orbit = solve_finite_difference(
            *system, orbits.theta, at_points((cycle.points.array() + 1e-3).matrix()), {}, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(orbit.rotation == std::vector<int>{1});
        const Eigen::Vector2d shift = (orbit.points - cycle.points).cwiseAbs();
        CHECK_THAT(shift(0) / (2.0 * pi), tests::WithinAbs(row.phi, row.half_unit_phi));
        CHECK_THAT(shift(1) / 29.3, tests::WithinAbs(row.phi_dot, row.half_unit_phi_dot));
        // The estimate is the larger of the two, up to O(h^4).
        CHECK_THAT(orbit.discretisation_error, tests::WithinRel(row.phi_dot, 0.2));
    }
}

TEST_CASE("finite differences: multipliers and further orbits with an error of order two", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits orbits = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    int tested = 0;
    for (const tests::ReferenceOrbit& cycle : orbits.orbits) {
        if (cycle.period != 2 || tested >= 2) continue;
        for (const bool second_order : {true, false}) {
            CAPTURE(cycle.unstable_multiplier, second_order);
            std::array<double, 3> point_error{};
            std::array<double, 3> multiplier_error{};
            for (std::size_t r = 0; r < 3; ++r) {
                FiniteDifferenceOptions options;
                options.nodes = 400 << r;
                options.second_order = second_order;
                options.estimate_error = false;
                options.solver.scale = Eigen::Vector2d(2.0 * pi, 29.3);
                const PeriodicOrbit orbit =
                    solve_finite_difference(*system, orbits.theta, at_points(cycle.points), {}, options);
                REQUIRE(orbit.status == OrbitStatus::converged);
                CHECK(orbit.rotation == std::vector<int>{cycle.rotation});
                point_error[r] = (orbit.points - cycle.points).cwiseAbs().maxCoeff();
                multiplier_error[r] = std::abs(orbit.multipliers[0].real() / cycle.unstable_multiplier - 1.0);
            }
            // h^2: a fourth each time, up to higher powers of h.
            CHECK_THAT(std::log2(point_error[1] / point_error[2]), tests::WithinAbs(2.0, 0.1));
            CHECK_THAT(std::log2(multiplier_error[1] / multiplier_error[2]), tests::WithinAbs(2.0, 0.1));
        }
        ++tested;
    }
    CHECK(tested == 2);
}

TEST_CASE("finite differences: Hopf's cycle with unknown period", "[periodic]") {
    const tests::HopfNormalForm system;
    const VectorXd theta = system.default_parameters();
    StartingSolution start = at_points(Eigen::Vector2d(1.1, 0.2));
    start.time = 6.2;
    std::array<double, 3> error{};
    const std::vector<Index> free{1, 0};
    for (std::size_t r = 0; r < 3; ++r) {
        FiniteDifferenceOptions options;
        options.nodes = (100 << r) + 1;
        options.solver.maximum_distance = 1.0;
        const PeriodicOrbit orbit = solve_finite_difference(system, theta, start, free, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        error[r] = orbit.time / (2.0 * pi) - 1.0;
        CHECK_THAT(orbit.time_sensitivities(0), tests::WithinRel(-orbit.time, 1e-14));  // measured 7e-16
        REQUIRE(orbit.multipliers.size() == 1);
        if (r == 2) {
            // Measured 2.6e-4 and 1.2e-8 on 401 nodes, times ten.
            CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::exp(-4.0 * pi), 2.6e-3));
            CHECK(std::abs(orbit.trivial_multiplier - 1.0) < 1.2e-7);
        }
    }
    CHECK_THAT(std::log2(error[0] / error[1]), tests::WithinAbs(2.0, 0.05));
    CHECK_THAT(std::log2(error[1] / error[2]), tests::WithinAbs(2.0, 0.05));
}

TEST_CASE("finite differences: crossings of a section", "[periodic]") {
    const auto system = models::make_system("lorenz");
    const VectorXd theta = system->default_parameters();
    const tests::FlowOrbits table = tests::read_flow_orbits("lorenz");
    StartingSolution start;
    start.section = table.section;
    start.points = system->crossings(table.orbits[1].point, table.section, 3, 100.0, theta).states;
    FiniteDifferenceOptions options;
    options.nodes = 500;
    options.solver.scale = Eigen::Vector3d(20.0, 25.0, 25.0);
    const PeriodicOrbit orbit = solve_finite_difference(*system, theta, start, {}, options);
    REQUIRE(orbit.status == OrbitStatus::converged);
    // Good to the estimate of its own error, times three.
    CHECK(orbit.discretisation_error < 1e-3);
    CHECK((orbit.points - start.points).cwiseAbs().maxCoeff() / 20.0 < 3.0 * orbit.discretisation_error);
    CHECK(std::abs(orbit.time - table.orbits[1].time) < 1e-3);
    CHECK((orbit.points.row(2).array() - 27.0).abs().maxCoeff() < 1e-9);
}

TEST_CASE("finite differences: sensitivities of the discrete orbit", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits orbits = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const tests::ReferenceOrbit& cycle = orbits.orbits.front();
    for (const bool second_order : {true, false}) {
        for (const char* name : {"l", "k3", "omega"}) {
            CAPTURE(name, second_order);
            const Index index = system->parameter_index(name);
            FiniteDifferenceOptions options;
            options.nodes = 100;
            options.second_order = second_order;
            options.estimate_error = false;
            const auto solve = [&](double ln_shift, const std::vector<Index>& free) {
                VectorXd theta = orbits.theta;
                theta(index) *= std::exp(ln_shift);
                const PeriodicOrbit orbit =
                    solve_finite_difference(*system, theta, at_points(cycle.points), free, options);
                REQUIRE(orbit.status == OrbitStatus::converged);
                return orbit;
            };
            const MatrixXd slope = orbits.theta(index) * solve(0.0, {index}).sensitivities;
            const auto quotient = [&](double h) {
                return MatrixXd((solve(h, {}).points - solve(-h, {}).points).reshaped() / (2.0 * h));
            };
            const MatrixXd difference = (4.0 * quotient(1e-4) - quotient(2e-4)) / 3.0;
            // Worst measured 3.7e-10, times ten.
            CHECK((difference - slope).cwiseAbs().maxCoeff() < 4e-9 * slope.cwiseAbs().maxCoeff());
        }
    }
}

TEST_CASE("second-order structure is read off the equations", "[periodic]") {
    const auto structure = [](const char* name) {
        const auto system = models::make_system(name);
        const Index n = system->dimension();
        return periodic::second_order_structure(*system, system->default_parameters(), MatrixXd::Constant(n, 30, 0.3),
                                                VectorXd::Ones(n));
    };
    CHECK(structure("parametric_pendulum").complete);
    CHECK(structure("parametric_pendulum").velocity == std::vector<Index>{1, -1});
    CHECK(structure("driven_pendulum").complete);
    CHECK(structure("duffing").complete);
    CHECK(structure("double_pendulum").complete);
    CHECK_FALSE(structure("lorenz").complete);
    CHECK_FALSE(structure("rossler").complete);
    CHECK_FALSE(structure("lotka_volterra").complete);
}

TEST_CASE("finite differences refuse what makes no sense", "[periodic]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto henon = models::make_system("henon");
    VectorXd theta = pendulum->default_parameters();
    const StartingSolution start = at_points(Eigen::Vector2d(3.0, 6.4));
    CHECK_THROWS_WITH(solve_finite_difference(*henon, henon->default_parameters(), start, {}),
                      tests::ContainsSubstring("a map"));
    FiniteDifferenceOptions few;
    few.nodes = 4;
    CHECK_THROWS_WITH(solve_finite_difference(*pendulum, theta, start, {}, few),
                      tests::ContainsSubstring("nodes is 4"));
    theta(pendulum->parameter_index("k1")) = 1e-3;
    CHECK_THROWS_WITH(solve_finite_difference(*pendulum, theta, start, {}), tests::ContainsSubstring("not smooth"));
}

}  // namespace finite_difference_test
