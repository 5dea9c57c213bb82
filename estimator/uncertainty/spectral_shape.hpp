#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// How flat the spectrum of a sequence is near frequency zero.
///
///     shape[B - 1] = 1 / B sum_{j = 1..B} s(pi j / n) / s(0),   s(w) = 1 / |1 - sum_k phi_k e^(-i w k)|^2
///
/// the mean of the spectrum over the B lowest frequencies of a cosine transform, over its value at zero. phi: an
/// autoregression, its order between 1 and 4 (n / 8 at most) by Schwarz's criterion, coefficients by Levinson and
/// Durbin from correlations about zero. All ones when the sequence is zero or has fewer than 8 values.
/// @param values  consecutive values, shape (n); sums over bins if the sequence is long: rings average out, and drifts
///                beneath noise show.
/// @param most    largest B, > 0.
/// Source: Schwarz, Ann. Statist. 6 (1978) 461; the spectrum of an autoregression: Priestley, Spectral analysis and
/// time series (1981), section 7.8.
[[nodiscard]] std::vector<double> spectral_shape(const Eigen::VectorXd& values, Eigen::Index most);

/// Number of lowest frequencies over which the spectrum stays within `tolerance` of its value at zero, at least 1.
[[nodiscard]] Eigen::Index flat_frequencies(const std::vector<double>& shape, double tolerance);

}  // namespace orbid::estimator
