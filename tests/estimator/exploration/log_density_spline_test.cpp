#include "estimator/exploration/log_density_spline.hpp"

#include <cmath>
#include <numbers>

#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/normal.hpp>

#include "tests/catch.hpp"

namespace orbid::tests::log_density_spline_test {

namespace {

/// ln x of a gamma variable with shape 4 and rate 1: density exp(4 u - e^u) / 6.
estimator::LogDensitySpline log_gamma(int points) {
    std::vector<double> u;
    std::vector<double> value;
    for (int i = 0; i < points; ++i) {
        u.push_back(-4.0 + 8.0 * i / (points - 1.0));
        value.push_back(4.0 * u.back() - std::exp(u.back()) + 17.0);
    }
    return {u, value};
}

}  // namespace

TEST_CASE("a normal density is exact on any points", "[estimator]") {
    const std::vector<double> u{-7.0, -4.0, -2.5, -1.0, 0.3, 1.0, 2.0, 4.0, 5.5, 8.0};
    std::vector<double> value;
    for (const double x : u)
        value.push_back(-0.5 * x * x);
    const estimator::LogDensitySpline density(u, value);
    const boost::math::normal_distribution<double> normal;
    CHECK_THAT(density.log_normalisation(), WithinAbs(0.5 * std::log(2.0 * std::numbers::pi), 1e-9));
    for (const double p : {0.001, 0.025, 0.3, 0.5, 0.9, 0.975}) {
        // What lies beyond the ends is 1e-12, the rule of ten points is good to 1e-9 on an interval of three sds.
        CHECK_THAT(density.quantile(p), WithinAbs(boost::math::quantile(normal, p), 1e-7));
    }
    CHECK_THAT(density.expectation([](double x) { return x * x; }), WithinAbs(1.0, 1e-8));
    CHECK(density.quantile(0.0) == -7.0);
    CHECK(density.quantile(1.0) == 8.0);
}

TEST_CASE("a skew density is approached with the fourth order", "[estimator]") {
    const boost::math::gamma_distribution<double> gamma(4.0, 1.0);
    std::vector<double> errors;
    for (const int points : {9, 17, 33, 65}) {
        const auto density = log_gamma(points);
        errors.push_back(std::abs(std::exp(density.quantile(0.975)) - boost::math::quantile(gamma, 0.975)));
        if (points == 65) {
            CHECK_THAT(density.expectation([](double u) { return std::exp(u); }), WithinAbs(4.0, 4e-5));
            CHECK_THAT(density.log_normalisation(), WithinAbs(17.0 + std::log(6.0), 1e-5));
        }
    }
    // Observed orders over the last two halvings; four is promised.
    CHECK(std::log2(errors[1] / errors[2]) > 3.3);
    CHECK(std::log2(errors[2] / errors[3]) > 3.3);
}

TEST_CASE("two and three points give a line and a parabola", "[estimator]") {
    const estimator::LogDensitySpline line({0.0, 1.0}, {0.0, -1.0});
    CHECK_THAT(line.quantile(std::expm1(-0.5) / std::expm1(-1.0)), WithinAbs(0.5, 1e-13));
    // The normal density between -1 and 2; the rule of ten points is good to 1e-10 over an interval of 1.5 sds.
    const estimator::LogDensitySpline parabola({-1.0, 0.5, 2.0}, {-0.5, -0.125, -2.0});
    const boost::math::normal_distribution<double> normal;
    const double within = boost::math::cdf(normal, 2.0) - boost::math::cdf(normal, -1.0);
    CHECK_THAT(parabola.log_normalisation(), WithinAbs(std::log(std::sqrt(2.0 * std::numbers::pi) * within), 1e-10));
}

TEST_CASE("log densities refuse points that make no sense", "[estimator]") {
    using estimator::LogDensitySpline;
    CHECK_THROWS_AS(LogDensitySpline({0.0}, {0.0}), std::invalid_argument);
    CHECK_THROWS_AS(LogDensitySpline({0.0, 1.0}, {0.0}), std::invalid_argument);
    CHECK_THROWS_AS(LogDensitySpline({0.0, 0.0}, {0.0, 1.0}), std::invalid_argument);
    CHECK_THROWS_AS(LogDensitySpline({0.0, 1.0}, {0.0, std::nan("")}), std::invalid_argument);
    CHECK_THROWS_AS(log_gamma(9).quantile(1.5), std::invalid_argument);
    CHECK_THROWS_AS(log_gamma(9).quantile(std::nan("")), std::invalid_argument);
}

}  // namespace orbid::tests::log_density_spline_test
