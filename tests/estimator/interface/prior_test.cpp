#include "estimator/interface/prior.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <Eigen/LU>
#include <boost/math/distributions/cauchy.hpp>
#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/lognormal.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/gauss_kronrod.hpp>

#include "tests/catch.hpp"

namespace orbid::tests::prior_test {

namespace {

namespace dist = boost::math;
using namespace estimator;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

const std::vector<Prior>& proper_priors() {
    static const std::vector<Prior> priors{
        NormalPrior{-1.5, 0.3},       LogNormalPrior{2.0, 0.7},   UniformPrior{-1.0, 4.0}, HalfNormalPrior{0.4},
        HalfCauchyPrior{2.5},         GammaPrior{3.0, 2.0},       GammaPrior{0.6, 5.0},    StudentPrior{4.0, 1.0, 0.2},
        StudentPrior{1.0, -3.0, 2.0}, StudentPrior{1.5, 0.0, 1.0}};
    return priors;
}

/// Fourth-order central difference of f at x.
template <class F>
double difference(F&& f, double x, double h) {
    return (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h);
}

}  // namespace

TEST_CASE("densities are those of the textbook", "[estimator][prior]") {
    for (const double x : {1e-6, 0.02, 0.7, 1.0, 3.0, 40.0}) {
        CAPTURE(x);
        const auto check = [&](const Prior& prior, double density) {
            // Where the tabulated density itself has not lost its digits.
            if (density > 1e-290) CHECK_THAT(std::exp(-negative_log_density(prior, x)), WithinRel(density, 1e-11));
        };
        check(NormalPrior{1.2, 3.0}, dist::pdf(dist::normal(1.2, 3.0), x));
        check(LogNormalPrior{2.0, 0.7}, dist::pdf(dist::lognormal(std::log(2.0), 0.7), x));
        check(HalfNormalPrior{4.0}, 2.0 * dist::pdf(dist::normal(0.0, 4.0), x));
        check(HalfCauchyPrior{2.5}, 2.0 * dist::pdf(dist::cauchy(0.0, 2.5), x));
        check(GammaPrior{3.0, 2.0}, dist::pdf(dist::gamma_distribution<>(3.0, 0.5), x));
        check(GammaPrior{0.6, 0.1}, dist::pdf(dist::gamma_distribution<>(0.6, 10.0), x));
        check(StudentPrior{4.0, 1.0, 0.2}, dist::pdf(dist::students_t(4.0), (x - 1.0) / 0.2) / 0.2);
        // Many degrees of freedom: normal to 1 / dof times a few squares.
        check(StudentPrior{1e8, 1.0, 20.0}, dist::pdf(dist::students_t(1e8), (x - 1.0) / 20.0) / 20.0);
    }
    CHECK(negative_log_density(FlatPrior{}, 3.0) == 0.0);
    CHECK_THAT(negative_log_density(UniformPrior{-1.0, 4.0}, 0.0), WithinRel(std::log(5.0), 1e-15));
}

TEST_CASE("far tails do not overflow", "[estimator][prior]") {
    // -ln p = (dof + 1) ln(x / scale) + constant to leading order.
    const StudentPrior student{3.0, 0.0, 1.0};
    CHECK_THAT(negative_log_density(student, 1e200) - negative_log_density(student, 1e150),
               WithinRel(4.0 * 50.0 * std::log(10.0), 1e-12));
    CHECK_THAT(derivatives(student, 1e200).first, WithinRel(4.0 / 1e200, 1e-14));
    const HalfCauchyPrior cauchy{1.0};
    CHECK_THAT(negative_log_density(cauchy, 1e250),
               WithinRel(500.0 * std::log(10.0) + std::log(1.5707963267948966), 1e-14));
    CHECK_THAT(derivatives(cauchy, 1e250).first, WithinRel(2e-250, 1e-14));
}

TEST_CASE("outside the support there is no density", "[estimator][prior]") {
    for (const Prior& prior : {Prior{LogNormalPrior{2.0, 0.7}}, Prior{HalfNormalPrior{1.0}},
                               Prior{HalfCauchyPrior{1.0}}, Prior{GammaPrior{1.0, 1.0}}}) {
        CHECK(negative_log_density(prior, -1e-300) == infinity);
        CHECK(negative_log_density(prior, nan_value) == infinity);
        CHECK(support(prior).lower == 0.0);
        CHECK(support(prior).upper == infinity);
    }
    CHECK(negative_log_density(GammaPrior{0.5, 1.0}, 0.0) == infinity);
    CHECK(std::isfinite(negative_log_density(HalfNormalPrior{1.0}, 0.0)));
    CHECK(std::isfinite(negative_log_density(HalfCauchyPrior{1.0}, 0.0)));
    CHECK(negative_log_density(UniformPrior{0.0, 1.0}, 1.0 + 1e-15) == infinity);
    CHECK(support(UniformPrior{-1.0, 4.0}).lower == -1.0);
    CHECK(support(UniformPrior{-1.0, 4.0}).upper == 4.0);
    CHECK(support(StudentPrior{4.0, 1.0, 0.2}).lower == -infinity);
    CHECK(support(FlatPrior{}).upper == infinity);
}

TEST_CASE("between two quantiles lies the mass between them", "[estimator][prior]") {
    // Decades of the tails, so that every piece is smooth; together they are everything but 2e-9.
    const std::vector<double> p{1e-9, 1e-8, 1e-7,  1e-6,     1e-5,     1e-4,     1e-3,     1e-2,     0.1,     0.5,
                                0.9,  0.99, 0.999, 1 - 1e-4, 1 - 1e-5, 1 - 1e-6, 1 - 1e-7, 1 - 1e-8, 1 - 1e-9};
    for (std::size_t k = 0; k < proper_priors().size(); ++k) {
        const Prior& prior = proper_priors()[k];
        CAPTURE(k);
        for (std::size_t i = 0; i + 1 < p.size(); ++i) {
            const double lower = quantile(prior, p[i]);
            const double upper = quantile(prior, p[i + 1]);
            REQUIRE(lower < upper);
            const double mass = dist::quadrature::gauss_kronrod<double, 31>::integrate(
                [&](double x) { return std::exp(-negative_log_density(prior, x)); }, lower, upper, 10, 1e-10);
            CAPTURE(p[i]);
            // Rounding of 1 - p in the upper tail: 1e-16 / (p step).
            CHECK_THAT(mass, WithinRel(p[i + 1] - p[i], 1e-6) || WithinAbs(p[i + 1] - p[i], 1e-14));
        }
        CHECK(quantile(prior, 0.0) == support(prior).lower);
        CHECK(quantile(prior, 1.0) == support(prior).upper);
    }
    // So much mass near zero that the quantile underflows: still a positive number.
    CHECK(quantile(GammaPrior{1e-3, 1.0}, 1e-3) > 0.0);
    CHECK_THROWS_AS(quantile(FlatPrior{}, 0.5), std::invalid_argument);
    CHECK_THROWS_AS(quantile(NormalPrior{0.0, 1.0}, 1.5), std::invalid_argument);
    CHECK_THROWS_AS(quantile(NormalPrior{0.0, 1.0}, nan_value), std::invalid_argument);
}

TEST_CASE("derivatives agree with differences", "[estimator][prior]") {
    for (std::size_t k = 0; k < proper_priors().size(); ++k) {
        const Prior& prior = proper_priors()[k];
        for (const double p : {0.02, 0.3, 0.5, 0.8, 0.99}) {
            const double x = quantile(prior, p);
            const double width = quantile(prior, 0.75) - quantile(prior, 0.25);
            const double h = 1e-3 * std::min(width, x > 0.0 ? x : width);
            const PriorDerivatives d = derivatives(prior, x);
            CAPTURE(k, p, x);
            // Differences: truncation (1e-3)^4, rounding 1e-16 / 1e-3, of terms of size 1 / h.
            const double tolerance = 1e-9 / (1e3 * h);
            CHECK_THAT(d.first, WithinAbs(difference([&](double at) { return negative_log_density(prior, at); }, x, h),
                                          tolerance));
            CHECK_THAT(d.second, WithinAbs(difference([&](double at) { return derivatives(prior, at).first; }, x, h),
                                           tolerance / (1e3 * h)));
        }
    }
    CHECK(derivatives(FlatPrior{}, 2.0).first == 0.0);
    CHECK(derivatives(StudentPrior{3.0, 0.0, 1.0}, 5.0).second < 0.0);
}

TEST_CASE("standard deviations where they exist", "[estimator][prior]") {
    CHECK(standard_deviation(FlatPrior{}) == infinity);
    CHECK(standard_deviation(HalfCauchyPrior{1.0}) == infinity);
    CHECK(standard_deviation(StudentPrior{2.0, 0.0, 1.0}) == infinity);
    CHECK(standard_deviation(StudentPrior{1.0, 0.0, 1.0}) == infinity);
    CHECK(standard_deviation(NormalPrior{3.0, 0.25}) == 0.25);
    CHECK_THAT(standard_deviation(StudentPrior{5.0, 2.0, 3.0}),
               WithinRel(3.0 * dist::standard_deviation(dist::students_t(5.0)), 1e-14));
    CHECK_THAT(standard_deviation(GammaPrior{3.0, 2.0}),
               WithinRel(dist::standard_deviation(dist::gamma_distribution<>(3.0, 0.5)), 1e-14));
    CHECK_THAT(standard_deviation(LogNormalPrior{2.0, 0.7}),
               WithinRel(dist::standard_deviation(dist::lognormal(std::log(2.0), 0.7)), 1e-13));
    CHECK_THAT(standard_deviation(UniformPrior{-1.0, 4.0}), WithinRel(5.0 / std::sqrt(12.0), 1e-15));
    // E x = s sqrt(2 / pi), E x^2 = s^2.
    CHECK_THAT(standard_deviation(HalfNormalPrior{3.0}), WithinRel(3.0 * 0.60281027498908707, 1e-14));
    CHECK_FALSE(is_proper(FlatPrior{}));
    for (const Prior& prior : proper_priors())
        CHECK(is_proper(prior));
}

TEST_CASE("wrong priors are refused by name and value", "[estimator][prior]") {
    const auto refused = [](const Prior& prior, const std::string& what) {
        CHECK_THROWS_WITH(validate(prior), ContainsSubstring(what));
        CHECK_THROWS_AS(validate(prior), std::invalid_argument);
    };
    for (const double bad : {0.0, -1.0, infinity, nan_value}) {
        refused(NormalPrior{0.0, bad}, "sd of the normal prior");
        refused(LogNormalPrior{bad, 1.0}, "median of the log-normal prior");
        refused(LogNormalPrior{1.0, bad}, "log_sd of the log-normal prior");
        refused(HalfNormalPrior{bad}, "scale of the half-normal prior");
        refused(HalfCauchyPrior{bad}, "scale of the half-Cauchy prior");
        refused(GammaPrior{bad, 1.0}, "shape of the gamma prior");
        refused(GammaPrior{1.0, bad}, "rate of the gamma prior");
        refused(StudentPrior{bad, 0.0, 1.0}, "dof of the Student prior");
        refused(StudentPrior{1.0, 0.0, bad}, "scale of the Student prior");
    }
    for (const double bad : {infinity, nan_value}) {
        refused(NormalPrior{bad, 1.0}, "mean of the normal prior");
        refused(StudentPrior{3.0, bad, 1.0}, "location of the Student prior");
        refused(UniformPrior{-bad, 1.0}, "lower end of the uniform prior");
        refused(UniformPrior{0.0, bad}, "upper end of the uniform prior");
    }
    refused(UniformPrior{1.0, 1.0}, "must be above the lower end");
    for (const Prior& prior : proper_priors())
        CHECK_NOTHROW(validate(prior));
    CHECK_NOTHROW(validate(Prior{FlatPrior{}}));
}

TEST_CASE("joint normal prior: value, gradient and Hessian", "[estimator][prior]") {
    JointNormalPrior prior{{"a", "b", "c"}, Eigen::Vector3d(1.0, -2.0, 3e6), Eigen::MatrixXd(3, 3)};
    // Very different sizes: sds 1, 1e-5, 1e6, correlations 0.9, -0.3, 0.1.
    const Eigen::Vector3d sd(1.0, 1e-5, 1e6);
    Eigen::Matrix3d correlation;
    correlation << 1.0, 0.9, -0.3, 0.9, 1.0, 0.1, -0.3, 0.1, 1.0;
    prior.covariance = sd.asDiagonal() * correlation * sd.asDiagonal();
    CHECK_NOTHROW(validate(prior));
    const Eigen::Vector3d standard(0.5, -1.0, 2.0);
    const Eigen::Vector3d x = prior.mean + standard.cwiseProduct(sd);
    const double expected = 0.5 * standard.dot(correlation.inverse() * standard) +
                            0.5 * std::log(correlation.determinant()) + sd.array().log().sum() +
                            1.5 * std::log(2.0 * 3.141592653589793);
    // x - mean of b keeps 1e-5 / 2 / 1e-16 digits.
    CHECK_THAT(negative_log_density(prior, x), WithinRel(expected, 1e-9));
    const JointPriorDerivatives d = derivatives(prior, x);
    const Eigen::Vector3d gradient = (correlation.inverse() * standard).cwiseQuotient(sd);
    const Eigen::Matrix3d hessian =
        sd.cwiseInverse().asDiagonal() * correlation.inverse() * sd.cwiseInverse().asDiagonal();
    for (Eigen::Index i = 0; i < 3; ++i) {
        CHECK_THAT(d.gradient[i], WithinRel(gradient[i], 1e-8));
        for (Eigen::Index j = 0; j < 3; ++j) {
            CHECK_THAT(d.hessian(i, j), WithinRel(hessian(i, j), 1e-12));
            CHECK(d.hessian(i, j) == d.hessian(j, i));
        }
    }
    // Independent parameters: the sum of single priors.
    prior.covariance = sd.cwiseAbs2().asDiagonal();
    double sum = 0.0;
    for (Eigen::Index i = 0; i < 3; ++i)
        sum += negative_log_density(NormalPrior{prior.mean[i], sd[i]}, x[i]);
    CHECK_THAT(negative_log_density(prior, x), WithinRel(sum, 1e-13));
}

TEST_CASE("wrong joint priors are refused", "[estimator][prior]") {
    const JointNormalPrior good{{"a", "b"}, Eigen::Vector2d(1.0, 2.0), Eigen::Matrix2d::Identity()};
    CHECK_NOTHROW(validate(good));
    const auto refused = [&](const auto& change, const std::string& what) {
        JointNormalPrior prior = good;
        change(prior);
        CHECK_THROWS_AS(validate(prior), std::invalid_argument);
        CHECK_THROWS_WITH(validate(prior), ContainsSubstring(what));
    };
    using P = JointNormalPrior;
    refused([](P& p) { p.names.clear(); }, "needs at least one");
    refused([](P& p) { p.names[1] = "a"; }, "\"a\" is named twice");
    refused([](P& p) { p.mean = Eigen::VectorXd::Zero(3); }, "3 values for 2 names");
    refused([](P& p) { p.mean[1] = nan_value; }, "mean of \"b\"");
    refused([](P& p) { p.covariance = Eigen::MatrixXd::Identity(3, 3); }, "3 x 3, must be 2 x 2");
    refused([](P& p) { p.covariance(1, 1) = 0.0; }, "variance of \"b\" = 0 must be positive");
    refused([](P& p) { p.covariance(0, 0) = infinity; }, "variance of \"a\"");
    refused([](P& p) { p.covariance(0, 1) = 0.5; }, "must be symmetric");
    refused([](P& p) { p.covariance(0, 1) = p.covariance(1, 0) = nan_value; }, "must be symmetric");
    refused([](P& p) { p.covariance(0, 1) = p.covariance(1, 0) = 1.0; }, "positive definite");
    refused([](P& p) { p.covariance(0, 1) = p.covariance(1, 0) = -2.0; }, "positive definite");
}

}  // namespace orbid::tests::prior_test
