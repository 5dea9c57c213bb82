#include "periodic/stability/stability.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"
#include "tests/source_folder.hpp"

namespace stability_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::Bifurcation;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::Stability;
using periodic::StartingSolution;

namespace {

constexpr double pi = std::numbers::pi;

std::vector<Index> all_parameters(const models::System& system) {
    std::vector<Index> all(system.parameters().size());
    std::iota(all.begin(), all.end(), Index{0});
    return all;
}

PeriodicOrbit solve(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                    const std::vector<Index>& free) {
    periodic::ShootingOptions options;
    options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
    options.maximum_distance = 1.0;
    options.segment_growth = 1e3;  // differences of multipliers need all their digits
    PeriodicOrbit orbit = solve_multiple_shooting(system, theta, start, free, options);
    REQUIRE(orbit.status == OrbitStatus::converged);
    return orbit;
}

StartingSolution at_points(const MatrixXd& points) {
    StartingSolution start;
    start.points = points;
    return start;
}

/// Largest |X_j v_j - c v_{j+1}|, c chosen best, relative to |X_j v_j|.
double direction_error(const PeriodicOrbit& orbit, const Stability& stability, Index m) {
    double worst = 0.0;
    const std::size_t p = stability.directions.size();
    for (std::size_t j = 0; j < p; ++j) {
        const Eigen::VectorXcd image = orbit.jacobians[j] * stability.directions[j].col(m);
        const Eigen::VectorXcd next = stability.directions[(j + 1) % p].col(m);
        worst = std::max(worst, (image - next * next.dot(image)).norm() / image.norm());
    }
    return worst;
}

}  // namespace

TEST_CASE("Henon map: ln multipliers add up to p ln b", "[periodic]") {
    const auto system = models::make_system("henon");
    const VectorXd theta = system->default_parameters();
    const Index a = system->parameter_index("a");
    const Index b = system->parameter_index("b");
    MatrixXd guess(2, 4);
    guess << 1.1250699, -0.7067668, 0.6381940, 0.2177618, 0.0653285, 0.3375210, -0.2120300, 0.1914582;
    const PeriodicOrbit orbit = solve(*system, theta, at_points(guess), {a, b});
    const Stability result = stability(*system, theta, 0.0, orbit, std::vector<Index>{a, b});
    REQUIRE(result.simulated);
    CHECK(result.unstable == 1);
    CHECK(result.nearest == Bifurcation::none);
    const VectorXd sum = result.ln_multiplier_sensitivities.colwise().sum();
    CHECK_THAT(sum(0), tests::WithinAbs(0.0, 1e-10));
    CHECK_THAT(sum(1), tests::WithinAbs(4.0 / theta(b), 1e-10));
    for (const Index m : {0, 1})
        CHECK(direction_error(orbit, result, m) < 1e-11);
}

TEST_CASE("driven pendulum: both ln multipliers move as Liouville says", "[periodic]") {
    // mu_u mu_s = exp(-gamma p 2 pi / omega).
    const auto system = models::make_system("driven_pendulum");
    const VectorXd theta = system->default_parameters();
    for (const int p : {1, 3, 8}) {
        CAPTURE(p);
        const Eigen::Vector2d first = p == 1   ? Eigen::Vector2d(-1.199766773168538552, 0.448485514487017406)
                                      : p == 3 ? Eigen::Vector2d(1.597255513691785230, -0.569426218602855021)
                                               : Eigen::Vector2d(0.231239296403243094, -0.693575849999930851);
        const MatrixXd guess = system->ensemble(first, 0.0, static_cast<std::size_t>(p), theta).sections[0].leftCols(p);
        const PeriodicOrbit orbit = solve(*system, theta, at_points(guess), {0, 1, 2});
        const Stability result = stability(*system, theta, 0.0, orbit, std::vector<Index>{0, 1, 2});
        REQUIRE(result.simulated);
        const VectorXd sum = result.ln_multiplier_sensitivities.colwise().sum();
        const double size = result.ln_multiplier_sensitivities.cwiseAbs().maxCoeff();
        const double time = p * 2.0 * pi / theta(2);
        // Worst measured 1.7e-11 of the largest (p = 8: 8117), and 3e-10 for the directions; times ten.
        CHECK_THAT(sum(0), tests::WithinAbs(-time, 2e-10 * size));
        CHECK_THAT(sum(1), tests::WithinAbs(0.0, 2e-10 * size));
        CHECK_THAT(sum(2), tests::WithinAbs(theta(0) * time / theta(2), 2e-10 * size));
        for (const Index m : {0, 1})
            CHECK(direction_error(orbit, result, m) < 3e-9);
    }
}

// tests/reference/driven_pendulum_long.json: differences of fourth order of cycles solved in 113 bits.
TEST_CASE("torque-driven pendulum, periods 9 to 12: derivatives of both ln multipliers against 113 bits",
          "[periodic][reference]") {
    const auto system = models::make_system("driven_pendulum");
    const VectorXd theta = system->default_parameters();
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/driven_pendulum_long.json");
    const auto table = nlohmann::json::parse(stream);
    const auto number = [](const nlohmann::json& value) { return std::stod(value.get<std::string>()); };
    int tested = 0;
    double worst = 0.0;
    for (const auto& entry : table.at("cycles")) {
        if (!entry.contains("ln_unstable_by_gamma_A_omega")) continue;
        const Index p = entry.at("period");
        CAPTURE(p);
        MatrixXd points(2, p);
        for (Index j = 0; j < p; ++j)
            for (Index i = 0; i < 2; ++i)
                points(i, j) =
                    number(entry.at("points").at(static_cast<std::size_t>(j)).at(static_cast<std::size_t>(i)));
        const PeriodicOrbit orbit = solve(*system, theta, at_points(points), {0, 1, 2});
        const Stability result = stability(*system, theta, 0.0, orbit, std::vector<Index>{0, 1, 2});
        REQUIRE(result.simulated);
        VectorXd unstable(3), both(3);
        for (Index k = 0; k < 3; ++k)
            unstable(k) = number(entry.at("ln_unstable_by_gamma_A_omega").at(static_cast<std::size_t>(k)));
        // Liouville: ln of the product is -gamma p 2 pi / omega.
        const double time = static_cast<double>(p) * 2.0 * pi / theta(2);
        both << -time, 0.0, theta(0) * time / theta(2);
        const double size = unstable.cwiseAbs().maxCoeff();
        const VectorXd first = result.ln_multiplier_sensitivities.row(0).transpose() - unstable;
        const VectorXd second = result.ln_multiplier_sensitivities.row(1).transpose() - (both - unstable);
        worst = std::max({worst, first.cwiseAbs().maxCoeff() / size, second.cwiseAbs().maxCoeff() / size});
        ++tested;
    }
    CHECK(tested == 4);
    // Asked for: 1e-6. Measured 4.9e-11 of the largest derivative, times ten.
    CHECK(worst < 5e-10);
}

TEST_CASE("pendulum: derivatives of ln multipliers to six digits against differences of solved orbits",
          "[periodic][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    const tests::ReferenceOrbits table = tests::read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    int tested = 0;
    for (const std::size_t which : {std::size_t{0}, std::size_t{6}, std::size_t{12}, std::size_t{20}}) {
        const tests::ReferenceOrbit& cycle = table.orbits[which];
        const StartingSolution start = at_points(cycle.points);
        std::vector<Index> free;
        for (const char* name : {"l", "k2", "k3", "omega"})
            free.push_back(system->parameter_index(name));
        const PeriodicOrbit orbit = solve(*system, table.theta, start, free);
        const Stability result = stability(*system, table.theta, 0.0, orbit, free);
        REQUIRE(result.simulated);
        for (std::size_t k = 0; k < free.size(); ++k) {
            CAPTURE(which, cycle.period, cycle.unstable_multiplier, k);
            const auto quotient = [&](double h) {
                VectorXd ln[2];
                for (int side = 0; side < 2; ++side) {
                    VectorXd theta = table.theta;
                    theta(free[k]) *= std::exp(side == 0 ? h : -h);
                    const PeriodicOrbit moved = solve(*system, theta, start, {});
                    ln[side].resize(2);
                    for (Index m = 0; m < 2; ++m)
                        ln[side](m) = std::log(std::abs(moved.multipliers[static_cast<std::size_t>(m)]));
                }
                return VectorXd((ln[0] - ln[1]) / (2.0 * h));
            };
            // Sixth order: errors of the quotient from 1e-13 / h of rounding and h^6.
            const double h = 2e-4 / cycle.period;
            const VectorXd difference =
                (90.0 * quotient(h) - 36.0 * quotient(2.0 * h) + 6.0 * quotient(3.0 * h)) / 60.0;
            const VectorXd slope = table.theta(free[k]) * result.ln_multiplier_sensitivities.col(static_cast<Index>(k));
            // Asked for: 1e-6. Worst measured 1.4e-9, the rounding of the quotients.
            CHECK((difference - slope).cwiseAbs().maxCoeff() < 1.4e-8 * slope.cwiseAbs().maxCoeff());
            ++tested;
        }
    }
    CHECK(tested == 16);
}

TEST_CASE("complex pairs: |multiplier| moves with the damping alone", "[periodic]") {
    // Duffing's oscillator in a single well: mu mu* = exp(-delta T), so d ln|mu| / d delta = -T / 2 for both.
    const auto system = models::make_system("duffing");
    VectorXd theta = system->default_parameters();
    const auto index = [&](const char* name) { return system->parameter_index(name); };
    theta(index("alpha")) = 1.0;
    theta(index("gamma")) = 0.3;
    theta(index("omega")) = 2.3;
    const std::vector<Index> free = all_parameters(*system);
    const PeriodicOrbit orbit = solve(*system, theta, at_points(Eigen::Vector2d(-0.06, 0.03)), free);
    REQUIRE(orbit.multipliers[0].imag() > 0.0);
    const Stability result = stability(*system, theta, 0.0, orbit, free);
    REQUIRE(result.simulated);
    CHECK(result.unstable == 0);
    const double time = 2.0 * pi / 2.3;
    for (const Index m : {0, 1}) {
        for (Index k = 0; k < static_cast<Index>(free.size()); ++k) {
            CAPTURE(m, k);
            const double expected = k == index("delta")   ? -0.5 * time
                                    : k == index("omega") ? 0.5 * theta(index("delta")) * time / 2.3
                                                          : 0.0;
            CHECK_THAT(result.ln_multiplier_sensitivities(m, k), tests::WithinAbs(expected, 1e-10));
        }
        CHECK(direction_error(orbit, result, m) < 1e-11);
    }
}

TEST_CASE("Lorenz: ln multipliers of an orbit of unknown period", "[periodic]") {
    const auto system = models::make_system("lorenz");
    const VectorXd theta = system->default_parameters();
    const tests::FlowOrbits table = tests::read_flow_orbits("lorenz");
    StartingSolution start;
    start.section = table.section;
    start.points = system->crossings(table.orbits[1].point, table.section, 3, 100.0, theta).states;
    const std::vector<Index> free{0, 1, 2};
    const PeriodicOrbit orbit = solve(*system, theta, start, free);
    const Stability result = stability(*system, theta, 0.0, orbit, free);
    REQUIRE(result.simulated);
    CHECK(result.unstable == 1);
    // Liouville: the sum is -(sigma + 1 + beta) T.
    const VectorXd sum = result.ln_multiplier_sensitivities.colwise().sum();
    const double rate = theta(0) + 1.0 + theta(2);
    // The small multiplier is 2e-15. Worst measured 2e-12, and 7e-12 below.
    CHECK_THAT(sum(0), tests::WithinAbs(-orbit.time - rate * orbit.time_sensitivities(0), 2e-11));
    CHECK_THAT(sum(1), tests::WithinAbs(-rate * orbit.time_sensitivities(1), 2e-11));
    CHECK_THAT(sum(2), tests::WithinAbs(-orbit.time - rate * orbit.time_sensitivities(2), 2e-11));
    for (Index k = 0; k < 3; ++k) {
        CAPTURE(k);
        const auto quotient = [&](double h) {
            double ln[2];
            for (int side = 0; side < 2; ++side) {
                VectorXd moved = theta;
                moved(k) += side == 0 ? h : -h;
                ln[side] = std::log(std::abs(solve(*system, moved, start, {}).multipliers[0]));
            }
            return (ln[0] - ln[1]) / (2.0 * h);
        };
        const double difference = (4.0 * quotient(2e-3) - quotient(4e-3)) / 3.0;
        CHECK_THAT(result.ln_multiplier_sensitivities(0, k), tests::WithinAbs(difference, 7e-11));
    }
}

TEST_CASE("the bifurcation that is near is told by the multipliers", "[periodic]") {
    using periodic::nearest_bifurcation;
    CHECK(nearest_bifurcation({{3.0, 0.0}, {0.2, 0.0}}, 0.05) == Bifurcation::none);
    CHECK(nearest_bifurcation({{1.02, 0.0}, {0.2, 0.0}}, 0.05) == Bifurcation::fold);
    CHECK(nearest_bifurcation({{-0.99, 0.0}, {0.96, 0.0}}, 0.05) == Bifurcation::period_doubling);
    CHECK(nearest_bifurcation({{0.6, 0.79}, {0.6, -0.79}}, 0.05) == Bifurcation::neimark_sacker);
    CHECK(nearest_bifurcation({}, 0.05) == Bifurcation::none);
    CHECK(periodic::name(Bifurcation::none) == "none");
    CHECK(periodic::name(Bifurcation::fold) == "fold");
    CHECK(periodic::name(Bifurcation::period_doubling) == "period_doubling");
    CHECK(periodic::name(Bifurcation::neimark_sacker) == "neimark_sacker");
}

TEST_CASE("stability refuses orbits that tell too little", "[periodic]") {
    const auto system = models::make_system("henon");
    const VectorXd theta = system->default_parameters();
    const PeriodicOrbit orbit = solve(*system, theta, at_points(Eigen::Vector2d(0.63, 0.19)), {});
    CHECK(stability(*system, theta, 0.0, orbit, {}).directions.size() == 1);
    CHECK_THROWS_WITH(stability(*system, theta, 0.0, orbit, std::vector<Index>{0}),
                      tests::ContainsSubstring("sensitivities"));
    CHECK_THROWS_WITH(stability(*system, theta, 0.0, PeriodicOrbit{}, {}), tests::ContainsSubstring("no_progress"));
    CHECK_THROWS_WITH(stability(*system, theta, 0.0, orbit, {}, {.near = 0.0}), tests::ContainsSubstring("near"));
}

}  // namespace stability_test
