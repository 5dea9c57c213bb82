#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/collocation.hpp"
#include "periodic/solution/guess_correction.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "periodic/solution/winding_choice.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"
#include "tests/source_folder.hpp"

namespace nearest_orbit_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::ClosingError;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::ShootingOptions;
using periodic::solve_multiple_shooting;

namespace {

constexpr double pi = std::numbers::pi;

/// Every coordinate off by a normal number of that standard deviation, relative to the size of the attractor.
MatrixXd disturbed(const MatrixXd& points, double displacement, const Eigen::Vector2d& size, std::mt19937_64& draws) {
    std::normal_distribution<double> normal;
    MatrixXd guess = points;
    for (Index j = 0; j < guess.cols(); ++j)
        for (Index i = 0; i < 2; ++i)
            guess(i, j) += displacement * size(i) * normal(draws);
    return guess;
}

double distance(const MatrixXd& a, const MatrixXd& b) {
    double largest = 0.0;
    for (Index j = 0; j < a.cols(); ++j)
        largest = std::max({largest, std::abs(models::wrapped(a(0, j) - b(0, j))), std::abs(a(1, j) - b(1, j))});
    return largest;
}

/// A linear closing error of one step.
ClosingError one_step(const Eigen::Vector2d& error, const Eigen::Matrix2d& jacobian) {
    ClosingError closing;
    closing.simulated = true;
    closing.error = error;
    closing.jacobians = {jacobian};
    closing.by_ln_time.resize(2, 0);
    return closing;
}

}  // namespace

TEST_CASE("pendulum: from points one hundredth of the attractor off to the cycle they were disturbed from",
          "[periodic][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    const Eigen::Vector2d size(2.0 * pi, 29.3);
    std::mt19937_64 draws(7);
    int all = 0, right = 0;
    for (const char* file : {"pendulum_orbits_g9.81.json", "pendulum_orbits_g9.8348933.json"}) {
        const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, file);
        for (const tests::ReferenceOrbit& cycle : table.orbits)
            for (int draw = 0; draw < 3; ++draw) {
                CAPTURE(file, cycle.period, cycle.unstable_multiplier, draw);
                ShootingOptions options;
                options.scale = size;
                options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
                const PeriodicOrbit orbit = solve_multiple_shooting(
                    *system, table.theta, 0.0, disturbed(cycle.points, 1e-2, size, draws), {}, {}, options);
                ++all;
                right += orbit.status == OrbitStatus::converged && distance(orbit.points, cycle.points) < 1e-11 &&
                                 orbit.rotation == std::vector<int>{cycle.rotation}
                             ? 1
                             : 0;
            }
    }
    CHECK(all == 138);
    // 920 of 920 with twenty draws each; with the turns nearest to the flow of the points 882.
    CHECK(right >= 137);
}

TEST_CASE("torque-driven pendulum: the nearest orbit, or a name and what was found instead", "[periodic][reference]") {
    const auto system = models::make_system("driven_pendulum");
    const VectorXd theta = system->default_parameters();
    const Eigen::Vector2d size(2.0 * pi, 4.0);
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/driven_pendulum_orbits.json");
    const auto table = nlohmann::json::parse(stream);
    std::mt19937_64 draws(7);
    int all = 0, right = 0;
    for (const auto& entry : table.at("cycles")) {
        const auto number = [&](const char* key) { return std::stod(entry.at(key).get<std::string>()); };
        const auto p = entry.at("period").get<std::size_t>();
        const Eigen::Vector2d first(number("theta_0"), number("theta_dot_0"));
        const MatrixXd near = system->ensemble(first, 0.0, p, theta).sections[0].leftCols(static_cast<Index>(p));
        const MatrixXd points = solve_multiple_shooting(*system, theta, 0.0, near, {}, {}).points;
        for (int draw = 0; draw < 10; ++draw) {
            CAPTURE(p, number("unstable_multiplier"), draw);
            ShootingOptions options;
            options.scale = size;
            options.maximum_distance = 4.0 * 3e-3;
            const PeriodicOrbit orbit =
                solve_multiple_shooting(*system, theta, 0.0, disturbed(points, 3e-3, size, draws), {}, {}, options);
            ++all;
            if (orbit.status == OrbitStatus::converged && distance(orbit.points, points) < 1e-10) {
                ++right;
                continue;
            }
            CHECK(orbit.status != OrbitStatus::converged);
            if (orbit.status != OrbitStatus::other_orbit) continue;
            CHECK(orbit.distance > options.maximum_distance);
            CHECK(orbit.points.cols() == points.cols());
            CHECK(orbit.rotation.size() == 1);
            CHECK(orbit.multipliers.size() == 2);
        }
    }
    CHECK(all == 70);
    // 99 % of 140; 88 % by Newton's method alone, whose losses lie at periods 4 and 8.
    CHECK(right >= 67);
}

TEST_CASE("whole turns are those of the smallest correction", "[periodic]") {
    // J = X - 1 maps (1, 0) to (10, 1): an error of 0.55 turns along it is closed by 0.055 turns. The nearest turn,
    // one, leaves -0.45 turns, which take 0.045 and, for what is then open in the second coordinate, 0.1.
    Eigen::Matrix2d x;
    x << 11.0, 0.0, 1.0, 2.0;
    const ClosingError closing = one_step(2.0 * pi * Eigen::Vector2d(0.55, 0.055), x);
    const MatrixXd nearest = Eigen::Vector2d(1.0, 0.0);
    const VectorXd scale = VectorXd::Ones(2);
    CHECK(periodic::likely_turns(closing, nearest, {0}, scale, {}) == MatrixXd::Zero(2, 1));
    // The only node keeps its turn where the sum was asked for; and one that is nearly whole is not looked at.
    CHECK(periodic::likely_turns(closing, nearest, {0}, scale, std::vector<int>{1}) == nearest);
    const ClosingError certain = one_step(2.0 * pi * Eigen::Vector2d(1.05, 0.0), x);
    CHECK(periodic::likely_turns(certain, nearest, {0}, scale, {}) == nearest);
}

TEST_CASE("the shortest correction leaves alone what hardly matters", "[periodic]") {
    // J = diag(4, 1e-3), r = (2, 1e-3): min d^2 + w (J d + r)^2 is w r^2 / (1 + w J^2) in each coordinate.
    Eigen::Matrix2d x;
    x << 5.0, 0.0, 0.0, 1.001;
    const ClosingError closing = one_step(Eigen::Vector2d(2.0, 1e-3), x);
    const double expected = std::sqrt(10.0 * 4.0 / 161.0 + 10.0 * 1e-6 / (1.0 + 1e-5));
    CHECK_THAT(periodic::shortest_correction(closing, VectorXd::Ones(2), 10.0), tests::WithinRel(expected, 1e-12));
    // With other units of the coordinates the same in these units: J' = J where x is diagonal, r' = r / scale.
    const double scaled = std::sqrt(10.0 * 1.0 / 161.0 + 10.0 * 1e-6 / (1.0 + 1e-5));
    CHECK_THAT(periodic::shortest_correction(closing, Eigen::Vector2d(2.0, 1.0), 10.0),
               tests::WithinRel(scaled, 1e-12));
}

TEST_CASE("a rotation that no orbit near has: what turns there instead", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const tests::ReferenceOrbit& cycle = table.orbits.front();  // one turn per period
    REQUIRE(cycle.rotation == 1);
    ShootingOptions options;
    options.scale = Eigen::Vector2d(2.0 * pi, 29.3);
    const PeriodicOrbit orbit =
        solve_multiple_shooting(*system, table.theta, 0.0, cycle.points, std::vector<int>{7}, {}, options);
    CHECK(orbit.status == OrbitStatus::other_orbit);
    CHECK(orbit.rotation == std::vector<int>{1});
    CHECK(orbit.distance < 1e-9);
    CHECK(distance(orbit.points, cycle.points) < 1e-10);
}

TEST_CASE("an orbit asked for twice as long holds the shorter one", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const tests::ReferenceOrbit& cycle = table.orbits.front();
    const MatrixXd guess = (cycle.points.replicate(1, 3).array() + 1e-4).matrix();
    const PeriodicOrbit orbit = solve_multiple_shooting(*system, table.theta, 0.0, guess, {}, {});
    CHECK(orbit.status == OrbitStatus::shorter_period);
    CHECK(orbit.period == 3);
    CHECK(orbit.repeats == 3);
    CHECK(orbit.rotation == std::vector<int>{3});
    CHECK(distance(orbit.points, cycle.points.replicate(1, 3)) < 1e-10);
    // That of three rounds: the cube.
    CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::pow(cycle.unstable_multiplier, 3), 1e-8));
}

TEST_CASE("other methods begin at the nearest orbit, too", "[periodic]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    const Eigen::Vector2d size(2.0 * pi, 29.3);
    std::mt19937_64 draws(3);
    for (const std::size_t which : {std::size_t{1}, std::size_t{8}, std::size_t{12}}) {
        const tests::ReferenceOrbit& cycle = table.orbits[which];
        CAPTURE(which, cycle.period, cycle.unstable_multiplier);
        periodic::StartingSolution start;
        start.points = disturbed(cycle.points, 1e-2, size, draws);
        periodic::CollocationOptions options;
        options.solver.scale = size;
        options.halvings = 1;
        const PeriodicOrbit orbit = solve_collocation(*system, table.theta, start, {}, options);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(orbit.rotation == std::vector<int>{cycle.rotation});
        CHECK(distance(orbit.points, cycle.points) < 1e-4);
    }
}

TEST_CASE("points that repeat are counted, turns of angles as nothing", "[periodic]") {
    Eigen::MatrixXd points(2, 4);
    points << 3.14159263, 1.0, -3.14159263, 1.0, 2.0, -5.0, 2.0, -5.0;  // the angle differs by 5e-8 across the cut
    const Eigen::Vector2d scale(6.3, 5.0);
    CHECK(periodic::repeats_of(points, {0}, scale) == 2);
    CHECK(periodic::repeats_of(points, {}, scale) == 1);
    points(1, 2) = 2.1;
    CHECK(periodic::repeats_of(points, {0}, scale) == 1);
    CHECK(periodic::repeats_of(points, {0}, scale, 0.03) == 2);
    CHECK(periodic::repeats_of(Eigen::MatrixXd::Ones(2, 3), {0}, scale) == 3);
}

}  // namespace nearest_orbit_test
