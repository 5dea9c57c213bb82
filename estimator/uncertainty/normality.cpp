#include "estimator/uncertainty/normality.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <boost/math/distributions/normal.hpp>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

double below(double z) {
    return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

/// Values that differ by rounding only have no shape.
bool spreads(const Eigen::VectorXd& sample) {
    if (sample.size() < 2 || !sample.allFinite()) return false;
    const double range = sample.maxCoeff() - sample.minCoeff();
    return range > 1e-13 * sample.cwiseAbs().maxCoeff();
}

double central_moment(const Eigen::VectorXd& sample, int power) {
    return (sample.array() - sample.mean()).pow(power).mean();
}

template <std::size_t N>
double polynomial(const std::array<double, N>& coefficients, double x) {
    double value = 0.0;
    for (std::size_t i = N; i-- > 0;)
        value = value * x + coefficients[i];
    return value;
}

/// Weights of the lower half of the ordered sample, a_i > 0 (the upper half has the opposite sign); AS R94.
std::vector<double> shapiro_weights(int n) {
    const int half = n / 2;
    std::vector<double> weight(static_cast<std::size_t>(half));
    if (n == 3) {
        weight[0] = std::sqrt(0.5);
        return weight;
    }
    constexpr std::array last{0.0, 0.221157, -0.147981, -2.07119, 4.434685, -2.706056};
    constexpr std::array last_but_one{0.0, 0.042981, -0.293762, -1.752461, 5.682633, -3.582633};
    const boost::math::normal_distribution<double> normal;
    std::vector<double> m(weight.size());
    double square = 0.0;
    for (std::size_t i = 0; i < m.size(); ++i) {
        m[i] = boost::math::quantile(normal, (static_cast<double>(i) + 1.0 - 0.375) / (n + 0.25));
        square += 2.0 * m[i] * m[i];
    }
    const double length = std::sqrt(square);
    const double root = 1.0 / std::sqrt(static_cast<double>(n));
    weight[0] = polynomial(last, root) - m[0] / length;
    std::size_t first = 1;
    double rest = square - 2.0 * m[0] * m[0];
    double share = 1.0 - 2.0 * weight[0] * weight[0];
    if (n > 5) {
        weight[1] = polynomial(last_but_one, root) - m[1] / length;
        rest -= 2.0 * m[1] * m[1];
        share -= 2.0 * weight[1] * weight[1];
        first = 2;
    }
    const double factor = std::sqrt(rest / share);
    for (std::size_t i = first; i < weight.size(); ++i)
        weight[i] = -m[i] / factor;
    return weight;
}

double shapiro_probability(double one_minus_w, int n) {
    if (n == 3) {
        // Exact: the density of W for three values is known.
        const double angle = std::asin(std::sqrt(1.0 - one_minus_w)) - std::asin(std::sqrt(0.75));
        return std::clamp(6.0 / std::numbers::pi * angle, 0.0, 1.0);
    }
    constexpr std::array gamma{-2.273, 0.459};
    constexpr std::array small_mean{0.544, -0.39978, 0.025054, -6.714e-4};
    constexpr std::array small_ln_sd{1.3822, -0.77857, 0.062767, -0.0020322};
    constexpr std::array large_mean{-1.5861, -0.31082, -0.083751, 0.0038915};
    constexpr std::array large_ln_sd{-0.4803, -0.082676, 0.0030302};
    double y = std::log(one_minus_w);
    if (n <= 11) {
        const double limit = polynomial(gamma, n);
        if (y >= limit) return 0.0;
        y = -std::log(limit - y);
        return below(-(y - polynomial(small_mean, n)) / std::exp(polynomial(small_ln_sd, n)));
    }
    const double ln_n = std::log(static_cast<double>(n));
    return below(-(y - polynomial(large_mean, ln_n)) / std::exp(polynomial(large_ln_sd, ln_n)));
}

}  // namespace

double two_sided(double z) {
    return std::erfc(std::abs(z) / std::numbers::sqrt2);
}

double sample_skewness(const Eigen::VectorXd& sample) {
    return spreads(sample) ? central_moment(sample, 3) / std::pow(central_moment(sample, 2), 1.5) : nan_value;
}

double sample_kurtosis(const Eigen::VectorXd& sample) {
    return spreads(sample) ? central_moment(sample, 4) / std::pow(central_moment(sample, 2), 2.0) : nan_value;
}

TestResult anderson_darling(const Eigen::VectorXd& sample) {
    const Eigen::Index n = sample.size();
    if (n < 8 || !spreads(sample)) return undefined_test;
    const auto count = static_cast<double>(n);
    const double mean = sample.mean();
    const double sd = std::sqrt((sample.array() - mean).square().sum() / (count - 1.0));
    Eigen::VectorXd z = (sample.array() - mean) / sd;
    std::sort(z.begin(), z.end());
    double sum = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
        // ln of both tails through erfc, which keeps them apart from 0 as far as the numbers go.
        const double lower = std::max(below(z[i]), std::numeric_limits<double>::min());
        const double upper = std::max(below(-z[n - 1 - i]), std::numeric_limits<double>::min());
        sum += (2.0 * static_cast<double>(i) + 1.0) * (std::log(lower) + std::log(upper));
    }
    const double a = (-count - sum / count) * (1.0 + 0.75 / count + 2.25 / (count * count));
    double p = 0.0;
    if (a < 0.2)
        p = 1.0 - std::exp(-13.436 + 101.14 * a - 223.73 * a * a);
    else if (a < 0.34)
        p = 1.0 - std::exp(-8.318 + 42.796 * a - 59.938 * a * a);
    else if (a < 0.6)
        p = std::exp(0.9177 - 4.279 * a - 1.38 * a * a);
    else if (a < 10.0)
        p = std::exp(1.2937 - 5.709 * a + 0.0186 * a * a);
    else
        p = 3.7e-24;  // the last formula at its end; it turns up again beyond
    return {a, p};
}

TestResult skewness_test(const Eigen::VectorXd& sample) {
    const auto n = static_cast<double>(sample.size());
    if (sample.size() < 8 || !spreads(sample)) return undefined_test;
    const double y = sample_skewness(sample) * std::sqrt((n + 1.0) * (n + 3.0) / (6.0 * (n - 2.0)));
    const double beta =
        3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0) / ((n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0));
    const double w2 = std::sqrt(2.0 * (beta - 1.0)) - 1.0;
    const double z = std::asinh(y / std::sqrt(2.0 / (w2 - 1.0))) / std::sqrt(0.5 * std::log(w2));
    return {z, two_sided(z)};
}

TestResult kurtosis_test(const Eigen::VectorXd& sample) {
    const auto n = static_cast<double>(sample.size());
    if (sample.size() < 20 || !spreads(sample)) return undefined_test;
    const double variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) * (n + 1.0) * (n + 3.0) * (n + 5.0));
    const double x = (sample_kurtosis(sample) - 3.0 * (n - 1.0) / (n + 1.0)) / std::sqrt(variance);
    const double skew = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0)) *
                        std::sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)));
    const double a = 6.0 + 8.0 / skew * (2.0 / skew + std::sqrt(1.0 + 4.0 / (skew * skew)));
    const double denominator = 1.0 + x * std::sqrt(2.0 / (a - 4.0));
    const double z = (1.0 - 2.0 / (9.0 * a) - std::cbrt((1.0 - 2.0 / a) / denominator)) / std::sqrt(2.0 / (9.0 * a));
    return {z, two_sided(z)};
}

TestResult shapiro_wilk(const Eigen::VectorXd& sample) {
    const Eigen::Index n = sample.size();
    if (n < 3 || n > 5000 || !spreads(sample)) return undefined_test;
    const std::vector<double> weight = shapiro_weights(static_cast<int>(n));
    Eigen::VectorXd x = (sample.array() - sample.mean()) / (sample.maxCoeff() - sample.minCoeff());
    std::sort(x.begin(), x.end());
    x.array() -= x.mean();
    Eigen::VectorXd a = Eigen::VectorXd::Zero(n);
    for (std::size_t i = 0; i < weight.size(); ++i) {
        a[static_cast<Eigen::Index>(i)] = -weight[i];
        a[n - 1 - static_cast<Eigen::Index>(i)] = weight[i];
    }
    // 1 - W from the distances sqrt(SS) +- a^T x: W near 1 would lose its digits in the difference.
    const double root_a = a.norm();
    const double root_x = x.norm();
    const double product = a.dot(x);
    const double one_minus_w =
        (root_a * root_x - product) * (root_a * root_x + product) / (a.squaredNorm() * x.squaredNorm());
    return {1.0 - one_minus_w, shapiro_probability(std::max(one_minus_w, 1e-19), static_cast<int>(n))};
}

}  // namespace orbid::estimator
