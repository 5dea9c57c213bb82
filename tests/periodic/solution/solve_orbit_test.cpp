#include "periodic/solution/solve_orbit.hpp"

#include <cmath>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace solve_orbit_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using periodic::OrbitMethod;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;

TEST_CASE("the three methods find the same orbits, multipliers and sensitivities", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const std::vector<Index> free{system->parameter_index("l"), system->parameter_index("k2")};
    const Eigen::Vector2d scale(6.283, 29.3);
    periodic::ShootingOptions shooting;
    shooting.scale = scale;
    periodic::FiniteDifferenceOptions differences;
    differences.nodes = 800;
    differences.solver = shooting;
    periodic::CollocationOptions collocation;
    collocation.solver = shooting;
    int tested = 0;
    for (const std::size_t which : {std::size_t{0}, std::size_t{2}, std::size_t{5}}) {
        periodic::StartingSolution start;
        start.points = (table.orbits[which].points.array() + 1e-3).matrix();
        const PeriodicOrbit shot = solve_orbit(*system, table.theta, start, free, shooting);
        REQUIRE(shot.status == OrbitStatus::converged);
        CHECK(shot.discretisation_error == 0.0);
        for (const OrbitMethod& method : {OrbitMethod(differences), OrbitMethod(collocation)}) {
            CAPTURE(which, method.index());
            const PeriodicOrbit orbit = solve_orbit(*system, table.theta, start, free, method);
            REQUIRE(orbit.status == OrbitStatus::converged);
            CHECK(orbit.rotation == shot.rotation);
            CHECK(orbit.iterations > 0);
            const double error = ((orbit.points - shot.points).array().colwise() / scale.array()).abs().maxCoeff();
            // The estimate is no bound; it must not be off by more than three.
            CHECK(error < 3.0 * orbit.discretisation_error + 1e-12);
            CHECK(error < (method.index() == 1 ? 1e-5 : 1e-9));
            const double accuracy = method.index() == 1 ? 1e-3 : 1e-6;
            CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(shot.multipliers[0].real(), accuracy));
            CHECK_THAT(orbit.multipliers[1].real(), tests::WithinRel(shot.multipliers[1].real(), accuracy));
            CHECK((orbit.sensitivities - shot.sensitivities).cwiseAbs().maxCoeff() <
                  accuracy * shot.sensitivities.cwiseAbs().maxCoeff());
            CAPTURE(error, orbit.discretisation_error);
            ++tested;
        }
    }
    CHECK(tested == 6);
}

TEST_CASE("without options orbits are found by multiple shooting", "[periodic]") {
    const auto system = models::make_system("henon");
    periodic::StartingSolution start;
    start.points = Eigen::Vector2d(0.63, 0.19);
    const PeriodicOrbit orbit = solve_orbit(*system, system->default_parameters(), start, {});
    REQUIRE(orbit.status == OrbitStatus::converged);
    CHECK(std::abs(orbit.points(0, 0) - 0.6313544770895048) < 1e-14);
}

}  // namespace solve_orbit_test
