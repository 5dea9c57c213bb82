#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace pendulum_orbits_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::solve_multiple_shooting;

namespace {

/// A guess as a measurement would give it: 1e-3 off, the same way in every run.
MatrixXd displaced(const MatrixXd& points) {
    MatrixXd guess = points;
    for (Index j = 0; j < points.cols(); ++j) {
        guess(0, j) += 1e-3 * std::sin(5.0 * static_cast<double>(j) + 1.0);
        guess(1, j) += 1e-3 * std::cos(3.0 * static_cast<double>(j));
    }
    return guess;
}

PeriodicOrbit solve(const models::System& system, const Eigen::VectorXd& theta, const MatrixXd& guess,
                    const std::vector<int>& rotation = {}, const std::vector<Index>& free = {}) {
    periodic::ShootingOptions options;
    options.scale = Eigen::Vector2d(6.283, 29.3);  // range of the section
    options.flow.relative_tolerance = 1e-13;
    options.flow.absolute_tolerance = 1e-13;
    return solve_multiple_shooting(system, theta, 0.0, guess, rotation, free, options);
}

}  // namespace

TEST_CASE("pendulum: reference orbits and multipliers", "[periodic][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    for (const char* file : {"pendulum_orbits_g9.81.json", "pendulum_orbits_g9.8348933.json"}) {
        const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, file);
        REQUIRE(table.orbits.size() >= 23);
        for (const tests::ReferenceOrbit& reference : table.orbits) {
            CAPTURE(file, reference.period, reference.rotation, reference.unstable_multiplier);
            const PeriodicOrbit orbit = solve(*system, table.theta, displaced(reference.points));
            REQUIRE(orbit.status == OrbitStatus::converged);
            CHECK(orbit.rotation == std::vector<int>{reference.rotation});
            double worst = 0.0;
            for (int j = 0; j < reference.period; ++j) {
                worst = std::max(worst, std::abs(models::wrapped(orbit.points(0, j) - reference.points(0, j))));
                worst = std::max(worst, std::abs(orbit.points(1, j) - reference.points(1, j)));
            }
            // Worst measured 2.7e-12, the accuracy of the table (1e-12) and of the flow.
            CHECK(worst < 1e-11);
            REQUIRE(orbit.multipliers.size() == 2);
            // Worst measured 5e-12; twelve digits are given, ten asked for.
            CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(reference.unstable_multiplier, 5e-11));
            CHECK(orbit.multipliers[0].imag() == 0.0);
            // Seven digits are given: half a unit of the last one is up to 5e-7.
            CHECK_THAT(orbit.multipliers[1].real(), tests::WithinRel(reference.stable_multiplier, 5e-7));
        }
    }
}

// reference/facts: g = 9.8348933, d/d ln of l, m, k2, k3, e, A, g, to six digits.
TEST_CASE("pendulum: sensitivities of periodic points", "[periodic][reference]") {
    struct Row {
        int period;
        double unstable;
        std::array<double, 2> point;
        std::array<double, 7> phi, phi_dot;
    };
    const std::array table{Row{1,
                               -1.7135,
                               {2.966704, 6.399583},
                               {0.277781, 0.17441, -0.031162, -0.143248, -0.0394514, 0.102571, -0.0315322},
                               {2.39461, -0.0866759, 0.0170234, 0.0696525, -0.167389, 0.195438, -2.7634}},
                           Row{1,
                               18.494,
                               {0.191408, 11.421618},
                               {-0.268594, -0.192336, 0.0380578, 0.154278, -0.0189992, -0.204719, 0.0886409},
                               {-1.86983, 0.0837338, -0.0147042, -0.0690296, 0.168026, -1.06261, 3.09992}},
                           Row{2,
                               71.78,
                               {-0.111882, -9.539761},
                               {0.268067, 0.111567, -0.024956, -0.0866106, 0.00688598, 0.0835272, -0.12846},
                               {5.20733, -0.0630347, 0.0129131, 0.0501216, -0.221352, -0.148818, -5.18459}}};
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits orbits = tests::read_reference_orbits(*system, "pendulum_orbits_g9.8348933.json");
    std::vector<Index> free;
    for (const char* name : {"l", "m", "k2", "k3", "epsilon", "A", "g"})
        free.push_back(system->parameter_index(name));
    for (const Row& row : table) {
        CAPTURE(row.period, row.unstable);
        for (const tests::ReferenceOrbit& reference : orbits.orbits) {
            if (std::abs(reference.unstable_multiplier / row.unstable - 1.0) > 1e-4) continue;
            const PeriodicOrbit orbit = solve(*system, orbits.theta, reference.points, {}, free);
            REQUIRE(orbit.status == OrbitStatus::converged);
            // The table may hold the mirror partner, or the orbit from its other point.
            Index at = -1;
            double sign = 1.0;
            for (Index j = 0; j < orbit.points.cols(); ++j)
                for (const double s : {1.0, -1.0})
                    if (std::abs(s * orbit.points(0, j) - row.point[0]) < 1e-5 &&
                        std::abs(s * orbit.points(1, j) - row.point[1]) < 1e-5) {
                        at = j;
                        sign = s;
                    }
            REQUIRE(at >= 0);
            for (std::size_t k = 0; k < free.size(); ++k) {
                const Eigen::Vector2d slope =
                    sign * orbits.theta(free[k]) * orbit.sensitivities.block<2, 1>(2 * at, static_cast<Index>(k));
                CAPTURE(k);
                // Five digits. Half a unit of the table's sixth is 5e-6; two of its 42 entries (period 2: l and g of
                // phi) are 1.1e-5 off, where ours agree with the differences of the next test.
                CHECK_THAT(slope(0), tests::WithinRel(row.phi[k], 2e-5));
                CHECK_THAT(slope(1), tests::WithinRel(row.phi_dot[k], 2e-5));
            }
        }
    }
}

TEST_CASE("pendulum: sensitivities agree with differences of solved orbits", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.8348933.json");
    const auto found = std::find_if(table.orbits.begin(), table.orbits.end(), [](const tests::ReferenceOrbit& orbit) {
        return orbit.period == 2 && std::abs(orbit.unstable_multiplier - 71.78) < 0.01;
    });
    REQUIRE(found != table.orbits.end());
    for (const char* name : {"l", "g", "omega", "k3"}) {
        CAPTURE(name);
        const Index index = system->parameter_index(name);
        const PeriodicOrbit orbit = solve(*system, table.theta, found->points, {}, {index});
        const auto points_at = [&](double ln_shift) {
            Eigen::VectorXd theta = table.theta;
            theta(index) *= std::exp(ln_shift);
            const PeriodicOrbit moved = solve(*system, theta, found->points);
            REQUIRE(moved.status == OrbitStatus::converged);
            return MatrixXd(moved.points.reshaped());
        };
        // Central differences at h and 2 h, extrapolated: truncation of the order h^4 x fifth derivative, rounding
        // 1e-12 / h.
        const double h = 1e-4;
        const MatrixXd near = (points_at(h) - points_at(-h)) / (2.0 * h);
        const MatrixXd wide = (points_at(2.0 * h) - points_at(-2.0 * h)) / (4.0 * h);
        const MatrixXd difference = (4.0 * near - wide) / 3.0;
        const MatrixXd slope = table.theta(index) * orbit.sensitivities;
        // Worst measured 1e-8 of the largest; ten times that.
        CHECK((difference - slope).cwiseAbs().maxCoeff() < 1e-7 * slope.cwiseAbs().maxCoeff());
    }
}

TEST_CASE("pendulum: sensitivities obey the exact identities (M3)", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    std::vector<Index> free;
    for (const char* name : {"m", "k2", "k3", "l", "g", "A", "omega"})
        free.push_back(system->parameter_index(name));
    int tested = 0;
    for (const tests::ReferenceOrbit& reference : table.orbits) {
        CAPTURE(reference.period, reference.rotation, reference.unstable_multiplier);
        const PeriodicOrbit orbit = solve(*system, table.theta, reference.points, {}, free);
        REQUIRE(orbit.status == OrbitStatus::converged);
        MatrixXd s = orbit.sensitivities;
        for (Index k = 0; k < s.cols(); ++k)
            s.col(k) *= table.theta(free[static_cast<std::size_t>(k)]);
        MatrixXd velocity = MatrixXd::Zero(s.rows(), 1);
        for (Index j = 0; j < orbit.points.cols(); ++j)
            velocity(2 * j + 1) = orbit.points(1, j);
        const MatrixXd friction = s.col(1) + s.col(2);
        const double size = 1.0 + s.cwiseAbs().maxCoeff();
        // Asked for: 1e-9. Worst measured 4e-12 relative to the largest sensitivity, times ten is below that.
        CHECK((s.col(0) + friction).cwiseAbs().maxCoeff() < 1e-10 * size);
        CHECK((s.col(3) + s.col(4) + s.col(5) + 2.0 * friction).cwiseAbs().maxCoeff() < 1e-10 * size);
        CHECK((s.col(6) + 2.0 * s.col(4) + s.col(1) - velocity).cwiseAbs().maxCoeff() < 1e-10 * size);
        ++tested;
    }
    CHECK(tested == 23);
}

}  // namespace pendulum_orbits_test
