#include "periodic/solution/multiple_shooting.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"

namespace multiple_shooting_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;
using periodic::ShootingOptions;
using periodic::solve_multiple_shooting;

namespace {

constexpr double pi = std::numbers::pi;

PeriodicOrbit solve(const models::System& system, const MatrixXd& guess, const ShootingOptions& options = {},
                    const std::vector<int>& rotation = {}, const std::vector<Index>& free = {}) {
    return solve_multiple_shooting(system, system.default_parameters(), 0.0, guess, rotation, free, options);
}

}  // namespace

TEST_CASE("forced oscillator: orbit, multipliers and sensitivities in closed form", "[periodic]") {
    const tests::ForcedOscillator system;
    const VectorXd theta = system.default_parameters();
    const std::vector<Index> free{3, 0, 1, 2};
    for (const double phase : {0.0, 1.1}) {
        CAPTURE(phase);
        const Eigen::Vector2d exact = tests::ForcedOscillator::steady(phase, theta.cast<tests::Complex>()).real();
        const PeriodicOrbit orbit = solve_multiple_shooting(system, theta, phase, MatrixXd::Constant(2, 1, 0.5), {},
                                                            free, {.maximum_distance = 10.0});
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(orbit.rotation.empty());
        // Linear: one step, the second to see that it is there. Condition of I - M below 10: 1e-15 x 10.
        CHECK(orbit.iterations <= 3);
        CHECK((orbit.points - exact).cwiseAbs().maxCoeff() < 1e-14);
        const double decay = 0.5 * theta(1);
        const double time = 2.0 * pi / theta(3);
        const auto multiplier = std::exp(std::complex<double>(-decay, std::sqrt(theta(0) - decay * decay)) * time);
        REQUIRE(orbit.multipliers.size() == 2);
        CHECK(std::abs(orbit.multipliers[0].real() - multiplier.real()) < 1e-14);
        CHECK(std::abs(orbit.multipliers[0].imag() - std::abs(multiplier.imag())) < 1e-14);
        REQUIRE(orbit.sensitivities.rows() == 2);
        REQUIRE(orbit.sensitivities.cols() == 4);
        for (Index k = 0; k < 4; ++k) {
            Eigen::VectorXcd shifted = theta.cast<tests::Complex>();
            shifted(free[static_cast<std::size_t>(k)]) += tests::Complex(0.0, 1e-100);
            const Eigen::Vector2d slope = tests::ForcedOscillator::steady(phase, shifted).imag() / 1e-100;
            CHECK((orbit.sensitivities.col(k) - slope).cwiseAbs().maxCoeff() < 1e-13);
        }
    }
}

TEST_CASE("Newton on the nodes converges quadratically", "[periodic]") {
    // The error after k steps, from the distance to the converged orbit; Henon's period-4 orbit from a guess 0.03 away.
    const tests::HenonMap system;
    MatrixXd guess(2, 4);
    guess << 1.15, -0.73, 0.66, 0.24, 0.09, 0.31, -0.24, 0.17;
    const PeriodicOrbit exact = solve(system, guess);
    REQUIRE(exact.status == OrbitStatus::converged);
    std::vector<double> closing;
    for (int steps = 1; steps <= 3; ++steps) {
        const PeriodicOrbit stopped = solve(system, guess, {.tolerance = 1e-300, .maximum_iterations = steps});
        CHECK(stopped.status == OrbitStatus::iteration_limit);
        closing.push_back(stopped.residual);
    }
    // closing[k] is the error before step k + 1. f is quadratic with |f''| / 2 = a = 1.4, and |J^-1| stays below 3
    // here: e_{k+1} <= a |J^-1|^2 e_k^2 < 12.6 e_k^2, on each of two successive steps.
    for (std::size_t k = 0; k + 1 < closing.size(); ++k) {
        CAPTURE(k, closing[k], closing[k + 1]);
        CHECK(closing[k + 1] < 12.6 * closing[k] * closing[k] + 1e-15);
    }
    CHECK(closing[2] < 1e-9);
}

// 22 digits, from independent extended-precision computation; multipliers to the digits given.
TEST_CASE("Henon map: reference cycles and their multipliers", "[periodic][reference]") {
    struct Row {
        double x, y, unstable, stable;
        std::vector<double> along;
    };
    const std::vector<Row> table{
        {0.6313544770895047, 0.18940634312685142, -1.92373885815340712, 0.1559463223, {0.6313544770895048}},
        {-1.1313544770895047, -0.3394063431268514, 3.25982209789145239, -0.09202956204, {-1.1313544770895048}},
        {0.9758000511750563,
         -0.14274001535251678,
         -3.01010066774027049,
         -0.02989933226,
         {0.9758000511750563, -0.47580005117505625}},
        {1.1250699365356923,
         0.06532852971558936,
         -8.63944460489831631,
         -0.0009375602681,
         {1.1250699365356922, -0.7067667772194081, 0.6381939926271558, 0.21776176571863118}},
        {1.167111361517768,
         0.07020023148686242,
         -89.9199178993840851,
         -7.296492427e-07,
         {1.167111361517768, -0.836808270770539, 0.36978609361335885, 0.5575190617270794, 0.6757773222193475,
          0.5279107336017912, 0.8125675569530303, 0.23400077162287475}}};
    const tests::HenonMap system;
    for (const Row& row : table) {
        const auto p = static_cast<Index>(row.along.size());
        CAPTURE(p);
        MatrixXd guess(2, p);
        for (Index j = 0; j < p; ++j) {
            guess(0, j) = row.along[static_cast<std::size_t>(j)];
            guess(1, j) = 0.3 * row.along[static_cast<std::size_t>((j + p - 1) % p)];
        }
        guess.array() += 1e-3;
        const PeriodicOrbit orbit = solve(system, guess);
        REQUIRE(orbit.status == OrbitStatus::converged);
        CHECK(std::abs(orbit.points(0, 0) - row.x) < 1e-14);
        CHECK(std::abs(orbit.points(1, 0) - row.y) < 1e-14);
        CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(row.unstable, 1e-13));
        CHECK_THAT(orbit.multipliers[1].real(), tests::WithinRel(row.stable, 1e-9));  // ten digits are given
        // det J = -b at every point.
        CHECK_THAT(orbit.multipliers[0].real() * orbit.multipliers[1].real(),
                   tests::WithinRel(std::pow(-0.3, static_cast<double>(p)), 1e-12));
    }
}

TEST_CASE("logistic map: multipliers 2^p on prime cycles", "[periodic]") {
    // x = 2 cos(2 pi m / (2^p - 1)) doubles its angle under x^2 - 2; multipliers 2^p (period 5: all of this family).
    const tests::QuadraticMap system;
    for (const int p : {2, 3, 5, 11}) {
        CAPTURE(p);
        MatrixXd guess(1, p);
        double angle = 2.0 * pi / (std::pow(2.0, p) - 1.0);
        for (Index j = 0; j < p; ++j, angle *= 2.0)
            guess(0, j) = 2.0 * std::cos(angle) + 1e-5;
        const PeriodicOrbit orbit = solve(system, guess);
        if (p == 2) {  // 2 cos(2 pi / 3) = -1 is the fixed point
            CHECK(orbit.status == OrbitStatus::shorter_period);
            continue;
        }
        REQUIRE(orbit.status == OrbitStatus::converged);
        // Rounding of x_{j+1} moves the x_j nearest to 0 by eps |x_{j+1}| / (2 |x_j|), and the multiplier is
        // proportional to x_j: a share of eps / x_j^2; the other points contribute less than ten times that.
        const double smallest = orbit.points.cwiseAbs().minCoeff();
        CHECK_THAT(orbit.multipliers[0].real(), tests::WithinRel(std::pow(2.0, p), 2.2e-15 / (smallest * smallest)));
    }
}

TEST_CASE("angles: rotation from the guess, or as asked for; points wrapped", "[periodic]") {
    const tests::StandardMap system;  // b 0.4, k 5, w 0.3
    const double v = 2.0 * pi;
    const double phi = std::asin((v * 0.6 - 0.3) / 5.0);
    MatrixXd guess(2, 1);
    guess << phi + 0.05 + 4.0 * pi, v - 0.05;
    const PeriodicOrbit once = solve(system, guess);
    REQUIRE(once.status == OrbitStatus::converged);
    CHECK(once.rotation == std::vector<int>{1});
    CHECK(std::abs(once.points(0, 0) - phi) < 1e-14);
    CHECK(std::abs(once.points(1, 0) - v) < 1e-14);

    const PeriodicOrbit still = solve(system, guess, {.maximum_distance = 5.0}, {0});
    REQUIRE(still.status == OrbitStatus::converged);
    CHECK(still.rotation == std::vector<int>{0});
    CHECK(std::abs(still.points(1, 0)) < 1e-14);
    CHECK(std::abs(std::sin(still.points(0, 0)) + 0.06) < 1e-14);
    CHECK(std::abs(still.points(0, 0)) <= pi);
}

TEST_CASE("every way in which the search can end has its name", "[periodic]") {
    const tests::HenonMap henon;
    const tests::QuadraticMap quadratic;
    MatrixXd fixed(2, 1);
    fixed << 0.63, 0.19;

    SECTION("other orbit: converged farther away than allowed") {
        MatrixXd guess(2, 1);
        guess << 0.9, 0.1;
        const PeriodicOrbit far = solve(henon, guess, {.maximum_distance = 0.05});
        CHECK(far.status == OrbitStatus::other_orbit);
        CHECK(far.distance > 0.05);
        CHECK(solve(henon, guess, {.maximum_distance = 10.0}).status == OrbitStatus::converged);
    }
    SECTION("shorter period: the fixed point asked for as period 3") {
        CHECK(solve(henon, fixed.replicate(1, 3)).status == OrbitStatus::shorter_period);
    }
    SECTION("iteration limit") {
        CHECK(solve(henon, fixed, {.maximum_iterations = 1}).status == OrbitStatus::iteration_limit);
    }
    SECTION("not simulated: the guess overflows") {
        CHECK(solve(henon, MatrixXd::Constant(2, 1, 1e200)).status == OrbitStatus::not_simulated);
    }
    SECTION("no progress: x = x^2 + 1 has no real solution") {
        const PeriodicOrbit none =
            solve_multiple_shooting(quadratic, VectorXd::Constant(1, 1.0), 0.0, MatrixXd::Constant(1, 1, 0.4), {}, {});
        CHECK(none.status == OrbitStatus::no_progress);
    }
    SECTION("singular: the derivative at the guess is one") {
        const PeriodicOrbit none =
            solve_multiple_shooting(quadratic, VectorXd::Constant(1, 1.0), 0.0, MatrixXd::Constant(1, 1, 0.5), {}, {});
        CHECK(none.status == OrbitStatus::singular);
    }
    CHECK(periodic::name(OrbitStatus::converged) == "converged");
    CHECK(periodic::name(OrbitStatus::no_progress) == "no_progress");
    CHECK(periodic::name(OrbitStatus::iteration_limit) == "iteration_limit");
    CHECK(periodic::name(OrbitStatus::not_simulated) == "not_simulated");
    CHECK(periodic::name(OrbitStatus::singular) == "singular");
    CHECK(periodic::name(OrbitStatus::other_orbit) == "other_orbit");
    CHECK(periodic::name(OrbitStatus::shorter_period) == "shorter_period");
}

TEST_CASE("multiple shooting refuses what makes no sense", "[periodic]") {
    const tests::HenonMap henon;
    const tests::StandardMap standard;
    const MatrixXd guess = MatrixXd::Constant(2, 2, 0.1);
    const VectorXd theta = henon.default_parameters();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto refused = [&](const MatrixXd& points, const ShootingOptions& options, const std::string& rule) {
        CHECK_THROWS_WITH(solve(henon, points, options), tests::ContainsSubstring(rule));
    };
    refused(MatrixXd::Zero(3, 1), {}, "guess has shape (3, 1)");
    refused(MatrixXd::Zero(2, 0), {}, "guess has shape (2, 0)");
    refused(MatrixXd::Constant(2, 1, nan), {}, "guess must be finite");
    refused(guess, {.tolerance = nan}, "tolerance must be > 0");
    refused(guess, {.maximum_iterations = 0}, "maximum_iterations");
    refused(guess, {.minimum_damping = 1.0}, "minimum_damping");
    refused(guess, {.maximum_distance = 0.0}, "maximum_distance");
    refused(guess, {.scale = VectorXd::Zero(2)}, "scale");
    CHECK_THROWS_WITH(solve(henon, guess, {}, {1}), tests::ContainsSubstring("the model has 0 angles"));
    CHECK_THROWS_WITH(solve(standard, guess, {}, {1, 2}), tests::ContainsSubstring("the model has 1 angles"));
    CHECK_THROWS_WITH(solve(henon, guess, {}, {}, {2}), tests::ContainsSubstring("free parameter 2"));
    const auto lotka = models::make_system("lotka_volterra");
    CHECK_THROWS_WITH(solve(*lotka, guess), tests::ContainsSubstring("is autonomous"));
    CHECK_THROWS_AS(solve_multiple_shooting(henon, VectorXd::Zero(1), 0.0, guess, {}, {}), std::invalid_argument);
    CHECK_THROWS_AS(solve_multiple_shooting(henon, theta, nan, guess, {}, {}), std::invalid_argument);
    CHECK_THROWS_AS(solve_multiple_shooting(henon, VectorXd::Constant(2, nan), 0.0, guess, {}, {}),
                    std::invalid_argument);
}

}  // namespace multiple_shooting_test
