#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// The correlation of consecutive residuals.
struct Autocorrelation {
    double lag1 = 0.0;
    double windowed = 1.0;        ///< 1 + 2 sum of correlations up to a window of five times itself, in records
    double autoregressive = 1.0;  ///< (1 + lag1) / (1 - lag1)
    bool significant = false;     ///< |lag1| beyond three sds of white noise, 1 / sqrt(n)
    /// The more cautious of both, >= 1; 1 when not significant.
    double records = 1.0;
};

/// Autocorrelation of equidistant residuals about zero, pooled over uninterrupted sequences.
///
/// The mean is not subtracted: residuals of a right model have mean zero, and a remaining mean is correlation.
/// Undefined (fewer than three records, or all zero): lag1 = 0, not significant. Source: the window is Sokal's (Monte
/// Carlo methods in statistical mechanics, 1997): smallest W >= 5 tau(W).
[[nodiscard]] Autocorrelation autocorrelation(const std::vector<Eigen::VectorXd>& sequences);

}  // namespace orbid::estimator
