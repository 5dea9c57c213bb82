#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

/// Portmanteau statistic of the correlations r_1 ... r_lags of equidistant residuals about zero,
///
///     Q = n (n + 2) sum_k r_k^2 / n_k,   r_k = sum_t e_t e_{t+k} / sum_t e_t^2,   n_k = pairs at distance k
///
/// chi-squared with `lags` degrees of freedom when they are independent (approximately: residuals of a fit lose some).
/// n_k = n - k for one sequence; several uninterrupted sequences are pooled. The mean is not subtracted (see
/// autocorrelation()). nan when fewer than lags + 2 records, or all are zero. Source: Ljung and Box, Biometrika 65
/// (1978) 297.
[[nodiscard]] TestResult ljung_box(const std::vector<Eigen::VectorXd>& sequences, int lags);

/// Number of runs of equal sign as a standard normal deviate (negative: too few runs), two-sided p. Mean and variance
/// are those given the number of each sign. Zeros are left out. Means and variances of several sequences add up. nan
/// when no sequence has both signs. Source: Wald and Wolfowitz, Ann. Math. Statist. 11 (1940) 147.
[[nodiscard]] TestResult runs_test(const std::vector<Eigen::VectorXd>& sequences);

}  // namespace orbid::estimator
