#pragma once

#include <Eigen/Core>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

/// A statistic, and the probability of one at least as extreme when the hypothesis holds. nan: not defined for this
/// sample (too small, or all values equal).
struct TestResult {
    double statistic;
    double p;
};

inline constexpr TestResult undefined_test{nan_value, nan_value};

/// 97.5 % quantile of the standard normal density.
inline constexpr double normal_975 = 1.9599639845400545;

/// Probability of a standard normal deviate at least as far from zero.
[[nodiscard]] double two_sided(double z);

/// Anderson-Darling distance from the normal distribution with the sample's mean and variance (divisor n - 1). The
/// statistic includes the factor 1 + 0.75/n + 2.25/n^2. Needs n >= 8. Source: D'Agostino and Stephens, Goodness-of-fit
/// techniques (1986), table 4.9 (p within about 1 % of itself).
[[nodiscard]] TestResult anderson_darling(const Eigen::VectorXd& sample);

/// Skewness as a standard normal deviate, two-sided p. Needs n >= 8. Source: D'Agostino, Biometrika 57 (1970) 679.
[[nodiscard]] TestResult skewness_test(const Eigen::VectorXd& sample);

/// Kurtosis as a standard normal deviate, two-sided p. Needs n >= 20.
/// Source: Anscombe and Glynn, Biometrika 70 (1983) 227.
[[nodiscard]] TestResult kurtosis_test(const Eigen::VectorXd& sample);

/// W of Shapiro and Wilk; small W speaks against the normal distribution. Needs 3 <= n <= 5000.
/// Source: Royston's approximation, algorithm AS R94, Applied Statistics 44 (1995) 547.
[[nodiscard]] TestResult shapiro_wilk(const Eigen::VectorXd& sample);

/// Moments about the mean: m3 / m2^(3/2) and m4 / m2^2 (3 for the normal distribution), divisors n; nan when all
/// values are equal.
[[nodiscard]] double sample_skewness(const Eigen::VectorXd& sample);
[[nodiscard]] double sample_kurtosis(const Eigen::VectorXd& sample);

}  // namespace orbid::estimator
