// Orbits carried to a neighbouring theta: between the two tables of the pendulum, past Henon's first fold, refusals.
#include <cmath>
#include <stdexcept>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "periodic/search/parameter_start.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;

PeriodicOrbit solved(const models::System& system, const VectorXd& theta, const MatrixXd& points) {
    periodic::StartingSolution start;
    start.points = points;
    return solve_multiple_shooting(system, theta, start, {}, {});
}

}  // namespace

TEST_CASE("orbits of one table of the pendulum are carried to those of the other", "[periodic][parameter_start]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto from = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.81.json");
    const auto to = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.8348933.json");
    REQUIRE_FALSE(from.orbits.empty());
    std::vector<PeriodicOrbit> orbits;
    for (const auto& reference : from.orbits)
        orbits.push_back(solved(*pendulum, from.theta, reference.points));
    const auto carried = orbits_at(*pendulum, from.theta, to.theta, orbits);
    REQUIRE(carried.size() == orbits.size());
    for (std::size_t k = 0; k < carried.size(); ++k) {
        const auto& reference = from.orbits[k];
        CAPTURE(k, reference.period, reference.rotation, reference.unstable_multiplier);
        CHECK(carried[k].arrived);
        CHECK(carried[k].share == 1.0);
        CHECK(carried[k].lost == OrbitStatus::converged);
        double nearest = INFINITY;
        for (const auto& other : to.orbits) {
            if (other.points.cols() != carried[k].orbit.points.cols()) continue;
            for (Index shift = 0; shift < other.points.cols(); ++shift) {
                // The tables hold one of each mirror pair, not always the same one.
                double largest[] = {0.0, 0.0};
                for (Index j = 0; j < other.points.cols(); ++j) {
                    for (const int sign : {0, 1}) {
                        const VectorXd gap = (sign == 0 ? 1.0 : -1.0) * carried[k].orbit.points.col(j) -
                                             other.points.col((j + shift) % other.points.cols());
                        largest[sign] = std::max({largest[sign], std::abs(models::wrapped(gap(0))), std::abs(gap(1))});
                    }
                }
                nearest = std::min({nearest, largest[0], largest[1]});
            }
        }
        CHECK(nearest < 1e-11);  // digits of the tables
    }
}

TEST_CASE("an orbit that vanishes at a fold on the way is named as lost there", "[periodic][parameter_start]") {
    const auto henon = models::make_system("henon");
    VectorXd theta = henon->default_parameters();
    theta(0) = 0.2;
    VectorXd beyond = theta;
    beyond(0) = -0.4;
    // Fixed points a x^2 + (1 - b) x - 1 = 0 meet at a = -(1 - b)^2 / 4.
    const double b = theta(1);
    const double fold = -(1.0 - b) * (1.0 - b) / 4.0;
    const double x = (b - 1.0 + std::sqrt((1.0 - b) * (1.0 - b) + 4.0 * theta(0))) / (2.0 * theta(0));
    const std::vector<PeriodicOrbit> orbits{solved(*henon, theta, Eigen::Vector2d(x, b * x))};
    REQUIRE(orbits[0].status == OrbitStatus::converged);
    const auto carried = orbits_at(*henon, theta, beyond, orbits);
    CHECK_FALSE(carried[0].arrived);
    CHECK(carried[0].lost != OrbitStatus::converged);
    // Never beyond the fold, and not given up long before it: the points move as the root of the distance.
    const double reached = theta(0) + carried[0].share * (beyond(0) - theta(0));
    CHECK(reached >= fold);
    CHECK(reached < fold + 0.05);

    beyond(0) = -0.1;
    const auto whole = orbits_at(*henon, theta, beyond, orbits);
    REQUIRE(whole[0].arrived);
    const double there = (b - 1.0 + std::sqrt((1.0 - b) * (1.0 - b) + 4.0 * beyond(0))) / (2.0 * beyond(0));
    CHECK(std::abs(whole[0].orbit.points(0, 0) - there) < 1e-14);
}

TEST_CASE("carrying orbits refuses wrong calls", "[periodic][parameter_start]") {
    const auto henon = models::make_system("henon");
    const auto pendulum = models::make_system("parametric_pendulum");
    const VectorXd theta = henon->default_parameters();
    const std::vector<PeriodicOrbit> unsolved(1);
    CHECK_THROWS_AS(periodic::orbits_at(*henon, theta, theta, unsolved), std::invalid_argument);
    CHECK_THROWS_AS(periodic::orbits_at(*henon, theta, VectorXd::Zero(1), {}), std::invalid_argument);
    VectorXd outside = pendulum->default_parameters();
    outside(pendulum->parameter_index("l")) = -1.0;
    CHECK_THROWS_AS(periodic::orbits_at(*pendulum, pendulum->default_parameters(), outside, {}), std::invalid_argument);
    const auto refused = [&](auto change) {
        periodic::CarriedOrbitOptions options;
        change(options);
        CHECK_THROWS_AS(periodic::orbits_at(*henon, theta, theta, {}, options), std::invalid_argument);
    };
    refused([](auto& o) { o.first_step = 0.0; });
    refused([](auto& o) { o.smallest_step = std::nan(""); });
    refused([](auto& o) { o.largest_miss = -1.0; });
    refused([](auto& o) { o.section = models::Section{Eigen::Vector2d::UnitX(), 0.0, 1}; });
}
