#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

/// Whitened residuals of one group.
struct ResidualSample {
    Eigen::VectorXd residual;  ///< whitened e: independent with mean 0 and sd 1 if right
    /// Lengths of the uninterrupted sequences of equidistant records, in order, that make up `residual`. Empty: the
    /// records have no order, and independence is not tested.
    std::vector<Eigen::Index> sequences;
    double fitted = 0.0;          ///< how many parameters this group determined
    bool scale_estimated = true;  ///< the sd was estimated from these residuals
};

/// A record that does not fit its neighbours.
struct Outlier {
    Eigen::Index record = 0;
    double studentised = 0.0;  ///< externally: by a scale from which this record is left out
    double p = 1.0;            ///< two-sided, times n (Bonferroni), at most 1
};

struct ResidualDiagnostic {
    Eigen::Index count = 0;
    double mean = 0.0;
    double sd = 0.0;  ///< divisor n - 1; nan for one record
    double skewness = 0.0;
    double kurtosis = 0.0;   ///< 3 for the normal distribution
    TestResult mean_test{};  ///< mean over its standard error, t with n - 1 degrees of freedom
    TestResult anderson_darling{};
    TestResult shapiro_wilk{};
    TestResult skewness_test{};
    TestResult kurtosis_test{};
    double lag1 = 0.0;  ///< nan without sequences, as the next two
    TestResult ljung_box{};
    TestResult runs{};
    std::vector<Outlier> outliers;  ///< Bonferroni p below 5 %, worst first
};

/// Diagnostics of the error model of a group from its residuals: normality, independence, outliers.
///
///     s^2 = sum e^2 / nu,  nu = n (1 - h),  r_i = e_i / (s sqrt(1 - h)),  t_i = r_i sqrt((nu - 1) / (nu - r_i^2))
///
/// h = fitted / n for all records. t_i is t-distributed with nu - 1 degrees of freedom; with a known scale s = 1 and
/// t_i = r_i is normal. Independence is tested over min(10, n / 5) lags, at least 1 (Hyndman's rule). Undefined figures
/// (too few records) are nan. Tests of the distribution use the residuals unchanged. In a fit with few records per
/// parameter these are closer to normal and less correlated than the errors.
/// @throws std::invalid_argument for values that are not finite, fitted < 0, sequences that do not add up to the number
///         of records.
/// Source: Cook and Weisberg, Residuals and influence in regression (1982), chapter 2.
[[nodiscard]] ResidualDiagnostic diagnose(const ResidualSample& sample);

}  // namespace orbid::estimator
