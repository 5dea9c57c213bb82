#include "estimator/exploration/derived_marginal.hpp"

#include <cmath>

#include <Eigen/LU>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::derived_marginal_test {

namespace {

struct Fit {
    Eigen::MatrixXd x{9, 2};
    Eigen::VectorXd y{9};
    FunctionResidual residual;
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    estimator::Estimate estimate;
    std::vector<estimator::Marginal> marginals;

    explicit Fit(bool scale_known) {
        y << 1.1, 0.7, 0.9, 0.2, 0.1, -0.4, -0.1, -0.9, -0.8;
        for (Eigen::Index i = 0; i < 9; ++i)
            x.row(i) << 1.0, static_cast<double>(i) / 8.0;
        residual.add_group(group("y", 0.3, !scale_known));
        residual.add_block(layout("data", 9), linear(y, x));
        estimate = estimator::estimate(parameters, {&residual});
        marginals = estimator::marginals(parameters, {&residual}, {}, estimate);
    }
};

estimator::DerivedQuantity sum(double first, double second) {
    return {"phi", [=](const Eigen::VectorXd& theta) { return first * theta[0] + second * theta[1]; },
            [=](const Eigen::VectorXd&) { return Eigen::VectorXd(Eigen::Vector2d(first, second)); }};
}

}  // namespace

TEST_CASE("a linear combination in a linear model: exactly t, or normal with a known scale", "[estimator]") {
    for (const bool known : {false, true}) {
        const Fit fit(known);
        const Eigen::Matrix2d inverse = (fit.x.transpose() * fit.x).inverse();
        const Eigen::Vector2d theta = inverse * fit.x.transpose() * fit.y;
        const double variance = known ? 0.09 : (fit.y - fit.x * theta).squaredNorm() / 7.0;
        const boost::math::students_t_distribution<double> t(7.0);
        const boost::math::normal_distribution<double> normal;
        const double q = known ? boost::math::quantile(normal, 0.975) : boost::math::quantile(t, 0.975);
        for (const auto& [first, second] : {std::pair{1.0, 1.0}, std::pair{1.0, 0.5}, std::pair{2.0, -1.0}}) {
            CAPTURE(known, first, second);
            const Eigen::Vector2d g(first, second);
            const double sd = std::sqrt(variance * g.dot(inverse * g));
            const auto phi = derived_marginal(sum(first, second), fit.parameters, fit.estimate, fit.marginals);
            REQUIRE(phi.known);
            CHECK(phi.method == "mixture");
            // Components of finite number, tails of the carrying marginal: measured 4e-4 sds.
            CHECK_THAT(phi.mean, WithinAbs(g.dot(theta), 1e-4 * sd));
            CHECK_THAT(phi.median, WithinAbs(g.dot(theta), 1e-4 * sd));
            CHECK_THAT(phi.sd, WithinRel(known ? sd : sd * std::sqrt(7.0 / 5.0), 4e-3));
            CHECK_THAT(phi.lower95, WithinAbs(g.dot(theta) - q * sd, 4e-3 * sd));
            CHECK_THAT(phi.upper95, WithinAbs(g.dot(theta) + q * sd, 4e-3 * sd));
        }
    }
}

TEST_CASE("a monotone function of one parameter has the transformed quantiles", "[estimator]") {
    const Fit fit(true);
    const estimator::DerivedQuantity growth{
        "growth", [](const Eigen::VectorXd& theta) { return std::exp(-theta[1]); },
        [](const Eigen::VectorXd& theta) { return Eigen::VectorXd(Eigen::Vector2d(0.0, -std::exp(-theta[1]))); }};
    const auto result = derived_marginal(growth, fit.parameters, fit.estimate, fit.marginals);
    REQUIRE(result.known);
    CHECK(result.method == "transformed");
    CHECK(result.along == "b");
    const Eigen::Matrix2d c = 0.09 * (fit.x.transpose() * fit.x).inverse();
    const double b = (c * fit.x.transpose() * fit.y)[1] / 0.09;
    const double sd = std::sqrt(c(1, 1));
    const double q = boost::math::quantile(boost::math::normal_distribution<double>(), 0.975);
    // Log-normal; the quantiles of b are good to 1e-5 sds, the mean of the tails beyond e^-12 loses 1e-5.
    CHECK_THAT(result.median, WithinRel(std::exp(-b), 1e-4));
    CHECK_THAT(result.lower95, WithinRel(std::exp(-b - q * sd), 1e-4));
    CHECK_THAT(result.upper95, WithinRel(std::exp(-b + q * sd), 1e-4));
    CHECK_THAT(result.mean, WithinRel(std::exp(-b + 0.5 * sd * sd), 1e-3));
    CHECK_THAT(result.sd, WithinRel(std::exp(-b + 0.5 * sd * sd) * std::sqrt(std::expm1(sd * sd)), 5e-3));
}

TEST_CASE("a derived quantity that cannot be computed everywhere, or without marginals, says so", "[estimator]") {
    const Fit fit(true);
    const auto nothing = derived_marginal(sum(1.0, 1.0), fit.parameters, fit.estimate, {});
    CHECK_FALSE(nothing.known);
    CHECK_THAT(nothing.message, ContainsSubstring("no parameter"));
    // ln(b - its estimate) exists on one side only.
    const double b = fit.estimate.parameters[1].value;
    const estimator::DerivedQuantity half{
        "half", [b](const Eigen::VectorXd& theta) { return std::log(theta[1] - b); },
        [b](const Eigen::VectorXd& theta) { return Eigen::VectorXd(Eigen::Vector2d(0.0, 1.0 / (theta[1] - b))); }};
    const auto failed = derived_marginal(half, fit.parameters, fit.estimate, fit.marginals);
    CHECK_FALSE(failed.known);
    CHECK_THAT(failed.message, ContainsSubstring("cannot be computed"));
}

}  // namespace orbid::tests::derived_marginal_test
