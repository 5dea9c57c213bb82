#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/uncertainty/independence.hpp"
#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

/// Whitened residuals of one group.
struct ResidualSample {
    Eigen::VectorXd residual;  ///< whitened e: independent with mean 0 and sd 1 if right
    /// Lengths of the uninterrupted sequences of equidistant records, in order, that make up `residual`. Empty: the
    /// records have no order, and independence is not tested.
    std::vector<Eigen::Index> sequences;
    /// h_i in [0, 1]: derivative of the fitted value with respect to the reading; empty: unknown, taken as
    /// fitted / n for all.
    Eigen::VectorXd leverage;
    double fitted = 0.0;          ///< how many parameters this group determined; with leverages: their sum is taken
    bool scale_estimated = true;  ///< the sd was estimated from these residuals
};

struct DiagnosticOptions {
    int lags = 0;                 ///< of Ljung-Box; 0: min(10, n / 5), at least 1 (Hyndman's rule)
    double outlier_level = 0.05;  ///< of Bonferroni's probability, in (0, 1)
    std::size_t listed = 10;      ///< how many records of large leverage or influence are listed at most
};

/// A record that does not fit its neighbours.
struct Outlier {
    Eigen::Index record = 0;
    double studentised = 0.0;  ///< externally: by a scale from which this record is left out
    double p = 1.0;            ///< two-sided, times n (Bonferroni), at most 1
};

/// A record with influence on the estimate.
struct Influence {
    Eigen::Index record = 0;
    double leverage = 0.0;
    double cook = 0.0;  ///< Cook's distance r_i^2 h_i / (q (1 - h_i)): beyond 1 the record moves the estimate much
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
    Eigen::VectorXd studentised;         ///< externally, of every record; nan where the leverage is 1
    std::vector<Outlier> outliers;       ///< Bonferroni p below the level, worst first
    std::vector<Influence> leverages;    ///< beyond twice the mean leverage, largest first; empty without leverages
    std::vector<Influence> influential;  ///< largest Cook's distances beyond 4 / n, largest first; likewise
};

/// Diagnostics of the error model of a group from its residuals: normality, independence, outliers, influence.
///
///     s^2 = sum e^2 / nu,  nu = n - sum h,  r_i = e_i / (s sqrt(1 - h_i)),  t_i = r_i sqrt((nu - 1) / (nu - r_i^2))
///
/// t_i is t-distributed with nu - 1 degrees of freedom; with a known scale s = 1 and t_i = r_i is normal. Undefined
/// figures (too few records) are nan. Tests of the distribution use the residuals unchanged. In a fit with few records
/// per parameter these are closer to normal and less correlated than the errors.
/// @throws std::invalid_argument for values that are not finite, leverages outside [0, 1] or of the wrong number,
///         sequences that do not add up to the number of records, options out of their ranges.
/// Source: Cook and Weisberg, Residuals and influence in regression (1982), chapters 2 and 3.
[[nodiscard]] ResidualDiagnostic diagnose(const ResidualSample& sample, const DiagnosticOptions& options = {});

}  // namespace orbid::estimator
