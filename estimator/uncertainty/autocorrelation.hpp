#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

/// The correlation of consecutive residuals.
struct Autocorrelation {
    double lag1 = 0.0;
    bool significant = false;  ///< |lag1| beyond three sds of white noise, 1 / sqrt(n)
    /// Integrated correlation time in records, >= 1; 1 when not significant. The more cautious of two: 1 + 2 sum of
    /// correlations up to a window of five times itself, and (1 + lag1) / (1 - lag1).
    double records = 1.0;
};

/// Autocorrelation of equidistant residuals about zero, pooled over uninterrupted sequences.
///
/// The mean is not subtracted: residuals of a right model have mean zero, and a remaining mean is correlation.
/// Undefined (fewer than three records, or all zero): lag1 = 0, not significant. Source: the window is Sokal's (Monte
/// Carlo methods in statistical mechanics, 1997): smallest W >= 5 tau(W).
[[nodiscard]] Autocorrelation autocorrelation(const std::vector<Eigen::VectorXd>& sequences);

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
