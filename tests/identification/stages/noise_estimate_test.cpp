// Estimates with process noise against the exact likelihood of a linear model, and without any.

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "identification/stages/noise_estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace noise_estimate_test {

using namespace orbid;
using namespace orbid::orbits;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

/// x'' + c x' + k x = s W', read with errors.
struct Oscillator {
    double c = 0.3, k = 4.0, noise = 0.4, reading = 0.05, step = 0.1;

    [[nodiscard]] MatrixXd generator() const { return MatrixXd{{0.0, 1.0}, {-k, -c}}; }
};

/// exp(A) by scaling and a series that has ended.
MatrixXd exponential(const MatrixXd& a) {
    const MatrixXd small = a / 1024.0;
    MatrixXd sum = MatrixXd::Identity(a.rows(), a.cols()), term = sum;
    for (int i = 1; i < 12; ++i) {
        term = (term * small / static_cast<double>(i)).eval();
        sum += term;
    }
    for (int i = 0; i < 10; ++i)
        sum = (sum * sum).eval();
    return sum;
}

/// A record by small steps of a scheme that is exact for noise without forces (strong order 1).
Series record(const Oscillator& of, Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    constexpr int parts = 50;
    const double h = of.step / parts;
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"x", "1", false}};
    Segment segment;
    segment.label = "0";
    MatrixXd values(1, count);
    segment.times.resize(count);
    double x = 1.0, v = 0.0;
    for (Index i = 0; i < count; ++i) {
        segment.times[i] = of.step * static_cast<double>(i);
        values(0, i) = x + of.reading * normal(random);
        for (int j = 0; j < parts; ++j) {
            const double force = -of.k * x - of.c * v;
            x += h * v + 0.5 * h * h * force;
            v += h * force + of.noise * std::sqrt(h) * normal(random);
        }
    }
    segment.values = Readings(values);
    series.segments.push_back(std::move(segment));
    return series;
}

/// -ln of the likelihood with a flat prior of the first state, in closed form: the readings are normal with mean A z_0.
/// What Kalman's filter adds up step by step, with the same covariance of links.
double exact_value(const Oscillator& of, const VectorXd& y) {
    const Index n = y.size();
    const MatrixXd phi = exponential(of.generator() * of.step);
    const double t = of.step;
    const MatrixXd q = of.noise * of.noise * MatrixXd{{t * t * t / 3.0, t * t / 2.0}, {t * t / 2.0, t}};
    MatrixXd mean(n, 2), covariance = MatrixXd::Zero(n, n);
    MatrixXd power = MatrixXd::Identity(2, 2), state = MatrixXd::Zero(2, 2);
    for (Index i = 0; i < n; ++i) {
        mean.row(i) = power.row(0);
        MatrixXd later = state;
        for (Index j = i; j < n; ++j) {
            covariance(i, j) = covariance(j, i) = later(0, 0);
            later = (phi * later).eval();
        }
        state = (phi * state * phi.transpose() + q).eval();
        power = (phi * power).eval();
    }
    covariance += of.reading * of.reading * MatrixXd::Identity(n, n);
    const Eigen::LLT<MatrixXd> root(covariance);
    REQUIRE(root.info() == Eigen::Success);
    const MatrixXd a = root.matrixL().solve(mean);
    const VectorXd r = root.matrixL().solve(y);
    const MatrixXd information = a.transpose() * a;
    const VectorXd best = information.ldlt().solve(a.transpose() * r);
    return 0.5 * (r - a * best).squaredNorm() + MatrixXd(root.matrixL()).diagonal().array().log().sum() +
           0.5 * std::log(information.determinant()) +
           0.5 * static_cast<double>(n - 2) * std::log(2.0 * std::numbers::pi);
}

estimator::Estimate fitted(const Series& series, const Oscillator& start) {
    const auto system = models::make_system("duffing");
    VectorXd base(5);
    base << start.c, start.k, 0.0, 0.0, 1.0;
    models::ParameterBinding binding;
    binding.base = base;
    binding.parameter = {system->parameter_index("delta"), system->parameter_index("alpha")};
    binding.estimated = {0, 1};
    binding.estimated_count = 2;
    ShootingOptions options;
    options.observe = {"x"};
    options.interval = 1;
    options.matching.kind = Continuity::Kind::diffusion;
    options.matching.estimate = true;
    options.start = VectorXd{{start.c, start.k}};
    identification::ProblemResiduals residuals;
    residuals.shooting.push_back(std::make_unique<ShootingResidual>(system, binding, series, options));
    std::vector<estimator::FreeParameter> parameters(2);
    parameters[0].name = "delta";
    parameters[0].start = start.c;
    parameters[1].name = "alpha";
    parameters[1].start = start.k;
    estimator::EstimateOptions how;
    how.variance = estimator::Variance::ml;
    how.step_tolerance = 1e-8;
    how.verdict = false;
    how.clusters = estimator::Clusters::none;
    return identification::estimate_with_noise(parameters, residuals, {}, how);
}

Oscillator at(const estimator::Estimate& fit, Oscillator of) {
    of.c = fit.parameters[0].value;
    of.k = fit.parameters[1].value;
    of.reading = fit.scales[0].value;
    of.noise = fit.scales[1].value;
    return of;
}

}  // namespace

TEST_CASE("the likelihood of a linear oscillator with process noise is exact", "[identification][noise]") {
    const Oscillator truth;
    const Series series = record(truth, 60, 3);
    const VectorXd y = series.segments[0].values.row(0).transpose();
    const estimator::Estimate fit = fitted(series, {0.4, 4.4});
    CAPTURE(fit.message);
    REQUIRE(fit.status == estimator::EstimateStatus::converged);
    const Oscillator best = at(fit, truth);
    const double constant = 0.5 * static_cast<double>(y.size() - 2) * std::log(2.0 * std::numbers::pi);
    CHECK_THAT(fit.objective + constant, WithinRel(exact_value(best, y), 1e-9));
    // Its maximum is the estimate's, and its curvature gives the sds: by differences in all four unknowns.
    const auto value = [&](const VectorXd& move) {
        Oscillator there = best;
        there.c += move[0];
        there.k += move[1];
        there.reading *= std::exp(move[2]);
        there.noise *= std::exp(move[3]);
        return exact_value(there, y);
    };
    const VectorXd step = VectorXd{{0.02, 0.05, 0.02, 0.02}};
    VectorXd slope(4);
    MatrixXd curvature(4, 4);
    for (Index i = 0; i < 4; ++i)
        for (Index j = 0; j < 4; ++j) {
            const VectorXd a = step.cwiseProduct(VectorXd::Unit(4, i)), b = step.cwiseProduct(VectorXd::Unit(4, j));
            curvature(i, j) = (value(a + b) - value(a - b) - value(b - a) + value(-a - b)) / (4.0 * step[i] * step[j]);
        }
    for (Index i = 0; i < 4; ++i) {
        const VectorXd a = 0.1 * step.cwiseProduct(VectorXd::Unit(4, i));
        slope[i] = (8.0 * (value(a) - value(-a)) - (value(2.0 * a) - value(-2.0 * a))) / (1.2 * step[i]);
    }
    const VectorXd left = curvature.ldlt().solve(slope);
    const MatrixXd covariance = curvature.inverse();
    for (Index i = 0; i < 4; ++i)
        CHECK(std::abs(left[i]) < 2e-4 * std::sqrt(covariance(i, i)));
    // Parameters at fixed scales, scales with all else following.
    const MatrixXd of_theta = curvature.topLeftCorner(2, 2).inverse();
    for (Index i = 0; i < 2; ++i)
        CHECK_THAT(fit.parameters[static_cast<std::size_t>(i)].laplace_sd, WithinRel(std::sqrt(of_theta(i, i)), 0.05));
    for (Index i = 0; i < 2; ++i) {
        const auto& scale = fit.scales[static_cast<std::size_t>(i)];
        CHECK_THAT(scale.uncertainty / scale.value, WithinRel(std::sqrt(covariance(2 + i, 2 + i)), 0.05));
    }
}

TEST_CASE("without process noise its estimate is at its bound", "[identification][noise]") {
    Oscillator truth;
    truth.noise = 0.0;
    int at_bound = 0;
    for (unsigned seed = 1; seed <= 6; ++seed) {
        const Series series = record(truth, 200, seed);
        const estimator::Estimate fit = fitted(series, {0.35, 4.2});
        CAPTURE(seed, fit.message);
        REQUIRE(fit.status == estimator::EstimateStatus::converged);
        const auto& noise = fit.scales[1];
        if (std::isfinite(noise.lower95)) continue;
        ++at_bound;
        CHECK(noise.value < 1e-3);
        // The estimate without noise, by least squares over whole courses.
        CHECK_THAT(fit.parameters[1].value, WithinAbs(4.0, 4.0 * fit.parameters[1].sd));
        CHECK(fit.parameters[1].sd < 0.03);
    }
    CHECK(at_bound >= 2);  // half of them in the mean: the estimate is as often above zero by chance
}

}  // namespace noise_estimate_test
