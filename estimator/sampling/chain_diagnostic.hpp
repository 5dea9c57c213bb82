#pragma once

#include <Eigen/Core>

namespace orbid::estimator {

// Is a sample long enough, and do its chains agree? One quantity at a time: draws of shape (iterations, chains). Source
// of all: Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian Analysis 16 (2021) 667. Details that the paper leaves
// open are as in the R package posterior 1.4.0, which the tests compare with. Every function returns nan for draws that
// are not finite, all equal, or fewer than twelve per chain.

/// Rank-normalised split R-hat, the larger of bulk and folded: 1 when all halves of all chains have the same
/// distribution, below 1.01 when they may be used.
[[nodiscard]] double rank_normalised_rhat(const Eigen::MatrixXd& draws);

/// Effective sample size of the centre of the distribution; by ranks, so that heavy tails do not matter.
[[nodiscard]] double bulk_effective_sample_size(const Eigen::MatrixXd& draws);

/// The smaller of the effective sample sizes of the 5 % and 95 % quantiles.
[[nodiscard]] double tail_effective_sample_size(const Eigen::MatrixXd& draws);

/// Effective sample size of the mean (finite variance assumed).
[[nodiscard]] double mean_effective_sample_size(const Eigen::MatrixXd& draws);
/// Effective sample size of a quantile.
/// @param probability  in (0, 1).
[[nodiscard]] double quantile_effective_sample_size(const Eigen::MatrixXd& draws, double probability);

/// Monte-Carlo standard error of the mean, of the standard deviation and of a quantile.
[[nodiscard]] double mean_standard_error(const Eigen::MatrixXd& draws);
[[nodiscard]] double sd_standard_error(const Eigen::MatrixXd& draws);
[[nodiscard]] double quantile_standard_error(const Eigen::MatrixXd& draws, double probability);

/// Quantile of all draws together, interpolated between order statistics at (count - 1) probability (Hyndman and Fan's
/// seventh definition). nan without draws.
[[nodiscard]] double sample_quantile(const Eigen::MatrixXd& draws, double probability);

}  // namespace orbid::estimator
