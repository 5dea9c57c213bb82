#include "estimator/exploration/marginal.hpp"

#include <cmath>
#include <functional>
#include <random>

#include <tbb/global_control.h>
#include <Eigen/LU>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::marginal_test {

namespace {

using estimator::Marginal;

/// Moments and quantiles of an unnormalised density on fine equal steps (trapezoidal: spectrally accurate for a
/// density that vanishes at both ends).
struct Table {
    double mean, sd, lower, median, upper;
};

Table tabulate(
    const std::function<double(double)>& log_density, double from, double to, int steps,
    const std::function<double(double)>& natural = [](double u) { return u; }) {
    std::vector<double> u(static_cast<std::size_t>(steps) + 1);
    std::vector<double> p(u.size());
    double highest = -1e300;
    for (std::size_t i = 0; i < u.size(); ++i) {
        u[i] = from + (to - from) * static_cast<double>(i) / steps;
        p[i] = log_density(u[i]);
        highest = std::max(highest, p[i]);
    }
    double sum = 0.0;
    double first = 0.0;
    double second = 0.0;
    for (std::size_t i = 0; i < u.size(); ++i) {
        p[i] = std::exp(p[i] - highest);
        const double weight = i == 0 || i + 1 == u.size() ? 0.5 : 1.0;  // a density may be cut off there
        const double x = natural(u[i]);
        sum += weight * p[i];
        first += weight * p[i] * x;
        second += weight * p[i] * x * x;
    }
    const auto quantile = [&](double level) {
        double running = 0.0;
        for (std::size_t i = 0; i + 1 < u.size(); ++i) {
            const double part = 0.5 * (p[i] + p[i + 1]) / sum;
            if (running + part >= level) return natural(u[i] + (u[i + 1] - u[i]) * (level - running) / part);
            running += part;
        }
        return natural(u.back());
    };
    const double mean = first / sum;
    return {mean, std::sqrt(second / sum - mean * mean), quantile(0.025), quantile(0.5), quantile(0.975)};
}

void check(const Marginal& marginal, const Table& expected, double tolerance) {
    CAPTURE(marginal.name, marginal.message);
    REQUIRE(marginal.known);
    CHECK_THAT(marginal.mean, WithinAbs(expected.mean, tolerance * expected.sd));
    CHECK_THAT(marginal.sd, WithinAbs(expected.sd, tolerance * expected.sd));
    CHECK_THAT(marginal.median, WithinAbs(expected.median, tolerance * expected.sd));
    CHECK_THAT(marginal.lower95, WithinAbs(expected.lower, tolerance * expected.sd));
    CHECK_THAT(marginal.upper95, WithinAbs(expected.upper, tolerance * expected.sd));
}

struct Regression {
    Eigen::MatrixXd x;
    Eigen::VectorXd y;
};

Regression made_regression(Eigen::Index n) {
    std::mt19937_64 generator(5);
    std::normal_distribution<double> normal;
    Regression data{Eigen::MatrixXd(n, 2), Eigen::VectorXd(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
        const double t = static_cast<double>(i) / static_cast<double>(n - 1);
        data.x.row(i) << 1.0, t;
        data.y[i] = 1.0 - 2.0 * t + 0.3 * normal(generator);
    }
    return data;
}

/// e = y - a exp(-b x), 12 records.
FunctionResidual::Function decay() {
    return [](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        const Eigen::ArrayXd x = Eigen::ArrayXd::LinSpaced(12, 0.0, 3.0);
        const Eigen::ArrayXd y = 2.0 * (-0.8 * x).exp() + 0.2 * (11.0 * x + 1.0).sin();
        const Eigen::ArrayXd shape = (-theta[1] * x).exp();
        estimator::BlockValue value;
        value.e = y - theta[0] * shape;
        value.e_theta.resize(12, 2);
        value.e_theta.col(0) = -shape;
        value.e_theta.col(1) = theta[0] * x * shape;
        value.e_z.resize(12, 0);
        return value;
    };
}

}  // namespace

TEST_CASE("marginals of a linear regression with unknown scale are Student's t and the chi distribution's",
          "[estimator]") {
    const Regression data = made_regression(12);
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 12), linear(data.y, data.x));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    const auto result = estimator::marginals(parameters, {&residual}, {}, estimate);
    REQUIRE(result.size() == 3);
    const Eigen::MatrixXd inverse = (data.x.transpose() * data.x).inverse();
    const Eigen::VectorXd theta = inverse * data.x.transpose() * data.y;
    const double rest = (data.y - data.x * theta).squaredNorm();
    const double dof = 10.0;
    const boost::math::students_t_distribution<double> t(dof);
    for (Eigen::Index j = 0; j < 2; ++j) {
        const double scale = std::sqrt(rest / dof * inverse(j, j));
        const double quantile = boost::math::quantile(t, 0.975);
        // Measured 1.5e-4 in the sd (tails of t beyond e^-12 of the maximum), 2e-5 in the rest.
        check(result[static_cast<std::size_t>(j)],
              {theta[j], scale * std::sqrt(dof / (dof - 2.0)), theta[j] - scale * quantile, theta[j],
               theta[j] + scale * quantile},
              2e-3);
    }
    // rest / s^2 is chi-squared with 10 degrees of freedom: E s = sqrt(rest / 2) Gamma(4.5) / Gamma(5), E s^2 = rest
    // / 8.
    const boost::math::chi_squared_distribution<double> chi(dof);
    const double mean = std::sqrt(0.5 * rest) * std::exp(std::lgamma(4.5) - std::lgamma(5.0));
    CHECK(result[2].name == "y.scale");
    check(result[2],
          {mean, std::sqrt(rest / 8.0 - mean * mean), std::sqrt(rest / boost::math::quantile(chi, 0.975)),
           std::sqrt(rest / boost::math::quantile(chi, 0.5)), std::sqrt(rest / boost::math::quantile(chi, 0.025))},
          2e-3);
    for (const Marginal& marginal : result) {
        CHECK(marginal.lower_end == estimator::MarginalEnd::fallen);
        CHECK(marginal.upper_end == estimator::MarginalEnd::fallen);
        CHECK(marginal.failed_points == 0);
        CHECK(marginal.points.size() >= 15);
        CHECK(marginal.points.size() <= 40);
        CHECK(marginal.message.empty());
        for (std::size_t k = 1; k < marginal.points.size(); ++k)
            CHECK(marginal.points[k].u > marginal.points[k - 1].u);
    }
}

TEST_CASE("marginals of normal posteriors with known scale, priors alone and together", "[estimator]") {
    const Regression data = made_regression(8);
    FunctionResidual residual;
    residual.add_group(group("y", 0.5, false));
    residual.add_block(layout("data", 8), linear(data.y, data.x));
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const Eigen::Matrix2d covariance = (Eigen::Matrix2d() << 0.04, 0.03, 0.03, 0.09).finished();
    const Eigen::Vector2d mean(0.5, -1.0);
    const auto expected = [&](const Eigen::Matrix2d& prior) {
        const Eigen::Matrix2d c = (data.x.transpose() * data.x / 0.25 + prior.inverse()).inverse();
        const Eigen::Vector2d m = c * (data.x.transpose() * data.y / 0.25 + prior.inverse() * mean);
        const double q = boost::math::quantile(boost::math::normal_distribution<double>(), 0.975);
        std::vector<Table> tables;
        for (Eigen::Index j = 0; j < 2; ++j) {
            const double sd = std::sqrt(c(j, j));
            tables.push_back({m[j], sd, m[j] - q * sd, m[j], m[j] + q * sd});
        }
        return tables;
    };
    estimator::EstimateOptions options;
    options.joint_priors = {{{"b", "a"}, mean.reverse(), covariance.reverse()}};
    const auto joint = estimator::estimate(parameters, {&residual}, {}, options);
    const auto together = estimator::marginals(parameters, {&residual}, options, joint);
    REQUIRE(together.size() == 2);
    // Normal on any grid: only the tails beyond e^-12 are missing, 2e-5 of the variance (measured 7e-6 of the sd).
    check(together[0], expected(covariance)[0], 1e-4);
    check(together[1], expected(covariance)[1], 1e-4);
    parameters[0].prior = estimator::NormalPrior{0.5, 0.2};
    parameters[1].prior = estimator::NormalPrior{-1.0, 0.3};
    const auto single = estimator::estimate(parameters, {&residual});
    const auto alone = estimator::marginals(parameters, {&residual}, {}, single);
    const Eigen::Matrix2d diagonal = covariance.diagonal().asDiagonal();
    check(alone[0], expected(diagonal)[0], 1e-4);
    check(alone[1], expected(diagonal)[1], 1e-4);
}

TEST_CASE("the marginal of a rate is exact in one dimension, on linear and log scale", "[estimator]") {
    // One unknown and a fixed scale: nothing is integrated, the density itself must come out.
    const auto function = [](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        const Eigen::ArrayXd x = Eigen::ArrayXd::LinSpaced(6, 0.5, 3.0);
        const Eigen::ArrayXd shape = (-theta[0] * x).exp();
        estimator::BlockValue value;
        value.e = (-0.7 * x).exp() + 0.1 * (9.0 * x).sin() - shape;
        value.e_theta = (x * shape).matrix();
        value.e_z.resize(6, 0);
        return value;
    };
    FunctionResidual residual;
    residual.add_group(group("y", 0.25, false));
    residual.add_block(layout("data", 6), function);
    std::vector<estimator::FreeParameter> parameters{free_parameter("rate", 1.0)};
    parameters[0].lower = 0.0;
    parameters[0].prior = estimator::GammaPrior{2.0, 1.5};
    const auto in_rate = [&](double rate) {
        const double square = function(Eigen::VectorXd::Constant(1, rate), {}, false).e.squaredNorm();
        return -0.5 * square / 0.0625 - negative_log_density(parameters[0].prior, rate);
    };
    const Table expected = tabulate([&](double u) { return in_rate(std::exp(u)) + u; }, -9.0, 3.5, 20000,
                                    [](double u) { return std::exp(u); });
    for (const auto scale : {estimator::Scale::linear, estimator::Scale::log}) {
        parameters[0].scale = scale;
        const auto estimate = estimator::estimate(parameters, {&residual});
        estimator::MarginalOptions fine;
        fine.step = 0.25;
        const auto result = estimator::marginals(parameters, {&residual}, {}, estimate, fine);
        // Measured 9e-4 (the sd on the linear scale, where ln p has a pole at the bound); half the step hardly matters.
        check(result.at(0), expected, 5e-3);
        check(estimator::marginals(parameters, {&residual}, {}, estimate).at(0), expected, 9e-3);
    }
}

TEST_CASE("two unknown scales: exact for the mean, by two-dimensional quadrature for the scales", "[estimator]") {
    // y_1 (9 records) and y_2 (7 records) both measure theta with scales of their own.
    Eigen::VectorXd first(9);
    first << 0.9, 1.4, 1.1, 0.6, 1.2, 0.8, 1.05, 1.3, 0.7;
    Eigen::VectorXd second(7);
    second << 1.9, 0.1, 2.4, 1.2, 0.4, 2.2, 0.9;
    FunctionResidual residual;
    residual.add_group(group("one"));
    residual.add_group(group("two"));
    residual.add_block(layout("first", 9, 0), linear(first, Eigen::MatrixXd::Ones(9, 1)));
    residual.add_block(layout("second", 7, 1), linear(second, Eigen::MatrixXd::Ones(7, 1)));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("theta", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto result = estimator::marginals(parameters, {&residual}, {}, estimate);
    REQUIRE(result.size() == 3);
    const auto square = [](const Eigen::VectorXd& y, double theta) { return (y.array() - theta).square().sum(); };
    // Scales flat in ln s are integrated in closed form: a product of two t densities.
    check(
        result[0],
        tabulate(
            [&](double theta) { return -4.5 * std::log(square(first, theta)) - 3.5 * std::log(square(second, theta)); },
            -0.5, 2.5, 20000),
        3e-3);
    // For each ln s_1: theta is normal given both scales, ln s_2 on a grid.
    const auto log_joint = [&](double x, double z) {
        const double w1 = std::exp(-2.0 * x);
        const double w2 = std::exp(-2.0 * z);
        const double weight = 9.0 * w1 + 7.0 * w2;
        const double theta = (w1 * first.sum() + w2 * second.sum()) / weight;
        return -9.0 * x - 7.0 * z - 0.5 * (w1 * square(first, theta) + w2 * square(second, theta)) -
               0.5 * std::log(weight);
    };
    const auto over_other = [&](double x, bool first_held) {
        double sum = 0.0;
        for (double z = -3.5; z < 3.5; z += 0.05)
            sum += std::exp(first_held ? log_joint(x, z) : log_joint(z, x));
        return std::log(sum);
    };
    const auto natural = [](double u) { return std::exp(u); };
    // Laplace over the other scale is off by a factor that hardly depends on the scale held: measured 9e-4 sds.
    check(result[1], tabulate([&](double x) { return over_other(x, true); }, -3.0, 1.5, 450, natural), 9e-3);
    check(result[2], tabulate([&](double x) { return over_other(x, false); }, -2.0, 2.5, 450, natural), 9e-3);
}

TEST_CASE("a nonlinear model of two parameters: the full Hessian brings the marginals to those of quadrature",
          "[estimator]") {
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 12), decay());
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 1.0), free_parameter("b", 1.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    estimator::MarginalOptions options;
    options.full_hessian = true;
    const auto full = estimator::marginals(parameters, {&residual}, {}, estimate, options);
    options.full_hessian = false;
    const auto gauss = estimator::marginals(parameters, {&residual}, {}, estimate, options);
    REQUIRE(full.size() == 3);
    CHECK(full[0].full_hessian);
    CHECK_FALSE(gauss[0].full_hessian);
    // The scale integrated in closed form (flat in ln s), the other parameter on a grid.
    const FunctionResidual::Function function = decay();
    const auto density = [&](double a, double b) {
        const double square = function(Eigen::Vector2d(a, b), {}, false).e.squaredNorm();
        return std::exp(-6.0 * std::log(square / 0.25));
    };
    const Table a = tabulate(
        [&](double x) {
            double sum = 0.0;
            for (double b = 0.1; b < 2.5; b += 0.03)
                sum += density(x, b);
            return std::log(sum);
        },
        1.0, 3.2, 800);
    const Table b = tabulate(
        [&](double x) {
            double sum = 0.0;
            for (double amplitude = 0.5; amplitude < 4.0; amplitude += 0.04)
                sum += density(amplitude, x);
            return std::log(sum);
        },
        0.1, 2.5, 800);
    // b alone is exact (a is linear, the scale in closed form); a: measured 1e-3 of a sd with the full Hessian, the
    // rest is the reference's steps. Gauss-Newton moves a by 1 % of its sd.
    check(full[0], a, 1e-2);
    check(full[1], b, 1e-2);
    check(gauss[0], a, 5e-2);
    check(gauss[1], b, 1e-2);
    CHECK(std::abs(full[0].mean - a.mean) < 0.2 * std::abs(gauss[0].mean - a.mean));
}

TEST_CASE("marginals end at bounds, report flat directions, and follow names and threads", "[estimator][threads]") {
    const Regression data = made_regression(8);
    FunctionResidual residual;
    residual.add_group(group("y", 0.5, false));
    residual.add_block(layout("data", 8), linear(data.y, data.x));
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.9), free_parameter("b", 0.0)};
    parameters[0].lower = 0.85;
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto result = estimator::marginals(parameters, {&residual}, {}, estimate);
    CHECK(result[0].lower_end == estimator::MarginalEnd::bound);
    CHECK(result[0].points.front().value == 0.85);
    CHECK(result[0].lower95 > 0.85);
    // A normal density cut off at the bound.
    const Eigen::Matrix2d c = (data.x.transpose() * data.x / 0.25).inverse();
    const double centre = (c * data.x.transpose() * data.y / 0.25)[0];
    const double sd = std::sqrt(c(0, 0));
    check(result[0],
          tabulate([&](double x) { return -0.5 * (x - centre) * (x - centre) / (sd * sd); }, 0.85, centre + 8.0 * sd,
                   40000),
          1e-3);
    estimator::MarginalOptions options;
    options.names = {"b"};
    for (const std::size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const auto named = estimator::marginals(parameters, {&residual}, {}, estimate, options);
        REQUIRE(named.size() == 1);
        CHECK(named[0].name == "b");
        CHECK(named[0].mean == result[1].mean);
        CHECK(named[0].upper95 == result[1].upper95);
    }
}

TEST_CASE("a tied parameter has no marginal of its own, the one it follows has that of both", "[estimator]") {
    // y = a + b t with b = -2 a: one column, 1 - 2 t.
    const Regression data = made_regression(12);
    std::vector<estimator::FreeParameter> parameters{free_parameter("b", 0.0), free_parameter("a", 0.0)};
    parameters[0].tied_to = "a";
    parameters[0].tie_factor = -2.0;
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 12), linear(data.y, data.x.rowwise().reverse()));
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    const auto result = estimator::marginals(parameters, {&residual}, {}, estimate);
    REQUIRE(result.size() == 2);
    CHECK(result[0].name == "a");
    const Eigen::VectorXd x = data.x * Eigen::Vector2d(1.0, -2.0);
    const double a = x.dot(data.y) / x.squaredNorm();
    const double dof = 11.0;
    const double scale = std::sqrt((data.y - a * x).squaredNorm() / dof / x.squaredNorm());
    const double q = boost::math::quantile(boost::math::students_t_distribution<double>(dof), 0.975);
    check(result[0], {a, scale * std::sqrt(dof / (dof - 2.0)), a - q * scale, a, a + q * scale}, 2e-3);
    for (const estimator::MarginalPoint& point : result[0].points) {
        REQUIRE(point.theta.size() == 2);
        CHECK(point.theta[0] == -2.0 * point.theta[1]);
        CHECK(point.theta[1] == point.value);
    }
    estimator::MarginalOptions options;
    options.names = {"b"};
    CHECK_THROWS_AS(estimator::marginals(parameters, {&residual}, {}, estimate, options), models::DataError);
}

TEST_CASE("the marginal of something the data say nothing about does not end", "[estimator]") {
    // Only a + b is measured.
    const Eigen::VectorXd y = Eigen::VectorXd::LinSpaced(6, 1.0, 2.0);
    FunctionResidual residual;
    residual.add_group(group("y", 0.5, false));
    residual.add_block(layout("data", 6), linear(y, Eigen::MatrixXd::Ones(6, 2)));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::singular);
    const auto result = estimator::marginals(parameters, {&residual}, {}, estimate);
    CHECK(result[0].upper_end == estimator::MarginalEnd::reach);
    CHECK(result[0].lower_end == estimator::MarginalEnd::reach);
    CHECK_THAT(result[0].message, ContainsSubstring("has not fallen"));
}

TEST_CASE("marginals refuse what makes no sense, and say when they are interrupted", "[estimator]") {
    const Regression data = made_regression(8);
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 8), linear(data.y, data.x));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.9), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto refuses = [&](auto change) {
        estimator::MarginalOptions options;
        change(options);
        CHECK_THROWS_AS(estimator::marginals(parameters, {&residual}, {}, estimate, options), std::invalid_argument);
    };
    refuses([](auto& options) { options.step = 0.0; });
    refuses([](auto& options) { options.fall = std::nan(""); });
    refuses([](auto& options) { options.reach = -1.0; });
    refuses([](auto& options) { options.maximum_points = 0; });
    estimator::MarginalOptions unknown;
    unknown.names = {"c"};
    CHECK_THROWS_AS(estimator::marginals(parameters, {&residual}, {}, estimate, unknown), models::DataError);
    CHECK_THROWS_AS(estimator::marginals({parameters[0]}, {&residual}, {}, estimate), std::invalid_argument);
    CHECK_THROWS_AS(estimator::marginals(parameters, {}, {}, estimate), std::invalid_argument);
    estimator::Estimate failed;
    CHECK_THROWS_AS(estimator::marginals(parameters, {&residual}, {}, failed), std::invalid_argument);
    estimator::EstimateOptions options;
    options.interrupted = [] { return true; };
    const auto stopped = estimator::marginals(parameters, {&residual}, options, estimate);
    REQUIRE(stopped.size() == 3);
    CHECK_FALSE(stopped[0].known);
    CHECK(stopped[0].lower_end == estimator::MarginalEnd::interrupted);
    CHECK(name(stopped[0].lower_end) == "interrupted");
}

}  // namespace orbid::tests::marginal_test
