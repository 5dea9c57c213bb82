#include <cmath>
#include <numbers>

#include "tests/catch.hpp"
#include "tests/orbits/cycle_residuals/cycle_case.hpp"

namespace cycle_estimation_test {

using namespace orbid;
using Eigen::Index;
using estimator::EstimateStatus;
using tests::CycleCase;

namespace {

/// The optimum is the truth within its own uncertainty (4 sds), and that is small (relative sd below the bounds).
void check_truth(const CycleCase& c, const estimator::Estimate& estimate, const std::vector<double>& largest_sd) {
    CHECK(estimate.status == EstimateStatus::converged);
    REQUIRE(estimate.parameters.size() == largest_sd.size());
    const Eigen::VectorXd truth = c.truth();
    for (std::size_t i = 0; i < largest_sd.size(); ++i) {
        const estimator::Estimated& parameter = estimate.parameters[i];
        CAPTURE(parameter.name, parameter.value, parameter.sd);
        const double true_value = truth(static_cast<Index>(i));
        CHECK(std::abs(parameter.value - true_value) < 4.0 * parameter.sd);
        CHECK(parameter.sd < largest_sd[i] * true_value);
    }
    for (const estimator::EstimatedScale& scale : estimate.scales) {
        // Told covariances are right: factors of 1 within five of their sds.
        CHECK(std::abs(scale.value - 1.0) < 5.0 * scale.uncertainty);
    }
    CHECK(estimate.counts.at(0).used == 41);  // 23 orbits, 20 with a partner, 2 at rest left out
    CHECK(estimate.counts.at(0).rejected == 0);
}

}  // namespace

// Points good to 1e-6 of the range. Bounds on the sds: the information of 41 cycles (sds measured 3.6e-6, 5.6e-7;
// 7.4e-5, 1.7e-5; 5.6e-7, 7.5e-5, 1.7e-5) times two.
TEST_CASE("cycles: the starts of the paper's tables reach the truth", "[orbits]") {
    SECTION("table I") {
        const CycleCase c({{"m", 1.5}, {"l", 1.2}});
        check_truth(c, estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-6, 1)), {7.2e-6, 1.1e-6});
    }
    SECTION("table II: from no friction at all, linear scale, bound 0") {
        const CycleCase c({{"k2", 0.0, true}, {"k3", 0.0, true}});
        check_truth(c, estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-6, 2)), {1.5e-4, 3.4e-5});
    }
    SECTION("table III") {
        const CycleCase c({{"l", 1.189}, {"k2", 1.336}, {"k3", 1.334}});
        check_truth(c, estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-6, 3)), {1.1e-6, 1.5e-4, 3.4e-5});
    }
    SECTION("table III at an error of 1e-3: a thousand times the sds") {
        const CycleCase c({{"l", 1.189}, {"k2", 1.336}, {"k3", 1.334}});
        check_truth(c, estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-3, 4)), {1.1e-3, 0.15, 3.4e-2});
    }
}

TEST_CASE("cycles: wide starts reach the truth", "[orbits]") {
    // l log-uniform in [0.5, 2], k2 and k3 uniform in [0, 10] times the truth. 40 of 40 reached it at an error
    // of 1e-6, 100 of 100 each at 1e-4 and 1e-3 when this was written; without the ladder 33 of 40 did. Five of them
    // here.
    tests::NormalNumbers random(7);
    for (int k = 0; k < 5; ++k) {
        const double l = std::exp(std::log(2.0) * (2.0 * random.uniform() - 1.0));
        const double k2 = 10.0 * random.uniform();
        const double k3 = 10.0 * random.uniform();
        CAPTURE(l, k2, k3);
        const CycleCase c({{"l", l}, {"k2", k2, true}, {"k3", k3, true}});
        check_truth(c, estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-6, 1)), {1.1e-6, 1.5e-4, 3.4e-5});
    }
}

TEST_CASE("cycles: one length, one mass and both frictions cannot be told apart", "[orbits]") {
    // Only k2/m and k3/m enter (M3): the direction in which m, k2 and k3 grow by the same factor is null.
    const CycleCase c({{"l", 1.1}, {"m", 1.1}, {"k2", 1.2}, {"k3", 0.9}});
    const auto estimate = estimate_from_cycles(c, tests::measured_cycles(c.table, 1e-6, 5));
    CHECK(estimate.status == EstimateStatus::singular);
    REQUIRE(estimate.null_directions.size() == 1);
    const Eigen::VectorXd& direction = estimate.null_directions[0].components;
    CHECK(std::abs(direction(0)) < 1e-6);
    CHECK(std::abs(direction(1) - direction(2)) < 1e-4);
    CHECK(std::abs(direction(1) - direction(3)) < 1e-4);
    CHECK(std::abs(std::abs(direction(1)) - 1.0) < 1e-4);
}

TEST_CASE("cycles: a wrong cycle is rejected and the estimate stays right", "[orbits]") {
    const CycleCase c({{"l", 1.1}, {"k3", 1.3}});
    std::vector<orbits::Cycle> cycles = tests::measured_cycles(c.table, 1e-6, 6);
    cycles[8].points(0, 0) += 1e-3;  // 160 of its sds
    const auto estimate = estimate_from_cycles(c, cycles);
    CHECK(estimate.status == EstimateStatus::converged);
    CHECK(estimate.counts.at(0).rejected == 1);
    CHECK(estimate.counts.at(0).used == 40);
    for (Index i = 0; i < 2; ++i) {
        const auto& parameter = estimate.parameters[static_cast<std::size_t>(i)];
        CAPTURE(parameter.name);
        CHECK(std::abs(parameter.value - c.truth()(i)) < 4.0 * parameter.sd);
    }
}

TEST_CASE("cycles with equal weights: the estimated sd is the residuals' own, in the coordinate's unit", "[orbits]") {
    // Started near the truth, so that the orbits alone decide; the errors are 1e-4 of the ranges 2 pi and 29.3 rad/s.
    const CycleCase c({{"l", 1.0}, {"k3", 1.0}});
    std::vector<orbits::Cycle> cycles = tests::measured_cycles(c.table, 1e-4, 8);
    for (orbits::Cycle& cycle : cycles)
        cycle.covariance.resize(0, 0);  // not asked for
    orbits::CycleResidualOptions options;
    options.targets.weights = orbits::CycleWeights::equal;
    orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth(), {}, options);

    // Derivatives by central differences: truncation 1e-10 x third derivative (1e4 over a chaotic period).
    const auto exact = residual.evaluate(residual.initial_set(), c.truth(), {}, true);
    for (Index k = 0; k < 2; ++k) {
        Eigen::VectorXd up = c.truth(), down = c.truth();
        const double h = 1e-5 * up(k);
        up(k) += h;
        down(k) -= h;
        const auto above = residual.evaluate(residual.initial_set(), up, {}, false),
                   below = residual.evaluate(residual.initial_set(), down, {}, false);
        for (std::size_t b = 0; b < exact.size(); ++b) {
            const Eigen::VectorXd difference = (above[b].e - below[b].e) / (2.0 * h);
            const double size = exact[b].e_theta.col(k).cwiseAbs().maxCoeff();
            CHECK((difference - exact[b].e_theta.col(k)).cwiseAbs().maxCoeff() < 1e-4 * size);
        }
    }

    estimator::EstimateOptions plain;
    plain.variance = estimator::Variance::ml;  // s^2 = e^T e / n (M10): no latent states
    const auto estimate = estimator::estimate(c.parameters, {&residual}, {}, plain);
    REQUIRE(estimate.status == EstimateStatus::converged);
    Eigen::VectorXd theta(2);
    theta << estimate.parameters[0].value, estimate.parameters[1].value;
    Eigen::Vector2d squares = Eigen::Vector2d::Zero();
    double count = 0.0;
    const auto at_optimum = residual.evaluate(residual.initial_set(), theta, {}, false);
    for (std::size_t b = 0; b < at_optimum.size(); ++b) {
        if (!residual.layout()[b].active) continue;
        squares += at_optimum[b].e.reshaped(2, at_optimum[b].e.size() / 2).rowwise().squaredNorm();
        count += static_cast<double>(at_optimum[b].e.size()) / 2.0;
    }
    REQUIRE(estimate.scales.size() == 2);
    CHECK(estimate.scales[0].unit == "rad");
    CHECK(estimate.scales[1].unit == "rad/s");
    const Eigen::Vector2d told(1e-4 * 2.0 * std::numbers::pi, 1e-4 * 29.3);
    for (Index i = 0; i < 2; ++i) {
        const estimator::EstimatedScale& scale = estimate.scales[static_cast<std::size_t>(i)];
        CAPTURE(scale.group, scale.value);
        // The minimiser stops where a step is a hundredth of a sd: the squares move by its square.
        CHECK_THAT(scale.value, tests::WithinRel(std::sqrt(squares(i) / count), 1e-4));
        CHECK(std::abs(scale.value - told(i)) < 5.0 * scale.uncertainty);
    }
}

}  // namespace cycle_estimation_test
