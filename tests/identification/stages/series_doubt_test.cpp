// When the estimate of a series may be the last word: what errors of reading leave, and what a wrong model leaves.

#include "identification/stages/series_doubt.hpp"

#include <cmath>
#include <numbers>
#include <random>

#include "identification/problem/estimate_setup.hpp"
#include "identification/starts/series_nodes.hpp"
#include "identification/strategy/identify.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace series_doubt_test {

using namespace orbid;
using identification::neighbour_correlation;
using identification::StateResiduals;

namespace {

/// States of the Henon map over a range of 2.6 and 0.8, and independent normal residuals.
StateResiduals henon_states(Eigen::Index count, unsigned seed) {
    StateResiduals left;
    left.states.resize(2, count);
    left.residual.resize(1, count);
    left.angle = {0, 0};
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    double x = 0.1, y = 0.1;
    for (Eigen::Index i = -100; i < count; ++i) {
        const double next = 1.0 - 1.4 * x * x + y;
        y = 0.3 * x;
        x = next;
        if (i < 0) continue;
        left.states.col(i) << x / 2.6, y / 0.8;
        left.residual(0, i) = 1e-3 * normal(random);
    }
    return left;
}

}  // namespace

TEST_CASE("independent errors leave neighbours nothing in common", "[identification]") {
    // The mean square of the correlation over its bound on the sd; 40 records tell it to a fifth or so.
    double square = 0.0;
    for (unsigned seed = 0; seed < 40; ++seed) {
        const auto found = neighbour_correlation(henon_states(1500, seed));
        CHECK(found.limit < 0.2);
        CHECK(std::abs(found.value) < found.limit);
        square += std::pow(5.0 * found.value / found.limit, 2) / 40.0;
    }
    CHECK(square < 1.5);
    CHECK(square > 0.3);
}

TEST_CASE("what depends on the state is in all neighbours", "[identification]") {
    StateResiduals left = henon_states(1500, 3);
    StateResiduals some = left;
    for (Eigen::Index i = 0; i < left.states.cols(); ++i)
        some.residual(0, i) += 1e-3 * std::sin(3.0 * std::numbers::pi * left.states(0, i));
    const auto found = neighbour_correlation(some);
    // A third of the variance, 0.5 / (1 + 0.5); cut off at three sds it is little less.
    CHECK_THAT(found.value, tests::WithinAbs(1.0 / 3.0, 0.1));
    CHECK(found.value > found.limit);
    // Alone it is all there is.
    for (Eigen::Index i = 0; i < left.states.cols(); ++i)
        left.residual(0, i) = std::sin(3.0 * std::numbers::pi * left.states(0, i));
    CHECK(neighbour_correlation(left).value > 0.95);
}

TEST_CASE("angles are neighbours across their seam", "[identification]") {
    // The second half lies a little beside the first, whole turns away, and has its residuals.
    StateResiduals left;
    constexpr Eigen::Index half = 300;
    left.states.resize(1, 2 * half);
    left.residual.resize(1, 2 * half);
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    for (Eigen::Index i = 0; i < half; ++i) {
        left.states(0, i) = static_cast<double>(i) / half - 0.5;
        left.states(0, half + i) = left.states(0, i) + 3.0 + 1e-4;
        left.residual(0, i) = left.residual(0, half + i) = normal(random);
    }
    left.angle = {0};
    CHECK(std::abs(neighbour_correlation(left).value) < 0.4);
    left.angle = {1};
    CHECK(neighbour_correlation(left).value > 0.9);
}

TEST_CASE("too few states, and residuals that are all alike, tell nothing", "[identification]") {
    StateResiduals left = henon_states(15, 1);
    CHECK(neighbour_correlation(left).limit > 1.0);
    left = henon_states(100, 1);
    CHECK(neighbour_correlation(left).limit > 0.6);
    left.residual.setZero();
    CHECK(neighbour_correlation(left).limit > 1.0);
    left = henon_states(600, 1);
    left.residual.leftCols(300).setConstant(std::nan(""));
    const auto half = neighbour_correlation(left);
    CHECK(half.limit > neighbour_correlation(henon_states(600, 1)).limit);
    CHECK(std::isfinite(half.value));
}

TEST_CASE("readings that are met to rounding have no errors", "[identification]") {
    const auto system = models::make_system("lorenz");
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.02, 60, 100};
    options.initial = Eigen::Vector3d(1.0, 1.3, 20.0);
    const Eigen::VectorXd theta = system->default_parameters();
    identification::IdentificationProblem problem;
    problem.system = system;
    problem.experiments.emplace_back();
    problem.experiments[0].series =
        std::make_shared<const orbits::Series>(orbits::simulate(*system, theta, options).series);
    problem.parameters.push_back(identification::free_parameter(*system, "sigma", 10.0));
    problem.series.emplace();
    problem.series->data = {0};
    problem.series->interval = 1;
    problem = identification::completed(problem);
    identification::SeriesStart start;
    start.theta = Eigen::VectorXd::Constant(1, 10.0);
    identification::StageRun run;
    const auto setup = identification::estimate_setup(problem, identification::fitted_labels(problem));
    identification::add_shooting(problem, setup, start, run.residuals);

    const auto scale = [](const char* group, double rms) {
        estimator::EstimatedScale one;
        one.group = group;
        one.count = 60;
        one.rms = rms;
        return one;
    };
    // x goes over some 30 units.
    run.estimate.scales = {scale("series.x", 1e-6), scale("series.y", 0.1), scale("series.z", 0.1),
                           scale("series.matching.x", 1e-12)};
    CHECK(identification::group_without_errors(run).empty());
    run.estimate.scales[0].rms = 1e-8;
    CHECK(identification::group_without_errors(run) == "series.x");
    run.estimate.scales[0].estimated = false;
    CHECK(identification::group_without_errors(run).empty());
}

}  // namespace series_doubt_test
