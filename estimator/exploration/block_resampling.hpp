#pragma once

#include <cstddef>
#include <vector>

#include "estimator/interface/random_stream.hpp"

namespace orbid::estimator {

/// Length of the blocks in which correlated errors are drawn, >= 1; 1: they show no correlation.
///
///     b = (2 G^2 / D)^(1/3) n^(1/3),   G = sum lambda(k/M) |k| R(k),   D = 4/3 (sum lambda(k/M) R(k))^2,   |k| <= M
///
/// lambda is flat to 1/2 and falls linearly to 0 at 1. M is twice the lag m after which max(5, sqrt(log10 n))
/// correlations in a row are below max(2 sqrt(log10 n), 3) / sqrt(n); no such lag before sqrt(n): that. At most
/// min(3 sqrt(n), n / 3). Autocovariances R are taken about the mean of all sequences, and pooled over them.
/// @param sequences  equidistant errors without interruption.
/// Source: D. N. Politis and H. White, Econometric Reviews 23 (2004) 53, for circular blocks; D as corrected with
///         A. Patton, ibid. 28 (2009) 372. The bound of three sds is ours: with few records two come by chance.
[[nodiscard]] std::size_t block_length(const std::vector<std::vector<double>>& sequences);

/// Indices below `pool` in blocks of consecutive ones, which go on at 0 beyond the end. Each is drawn equally often.
/// @param length  of a block, >= 1. @param pool  > 0.
/// Source: D. N. Politis and J. P. Romano, A circular block-resampling procedure for stationary data, in Exploring the
///         Limits of Bootstrap (Wiley 1992) 263; moving blocks: H. R. Kuensch, Annals of Statistics 17 (1989) 1217.
[[nodiscard]] std::vector<std::size_t> drawn_blocks(std::size_t count, std::size_t pool, std::size_t length,
                                                    RandomStream random);

/// Takes the mean off errors and scales them to a mean square of 1: what is drawn from them has mean 0 and sd 1.
/// @return false, and nothing done: they do not scatter, or are not finite.
[[nodiscard]] bool standardise(std::vector<double>& errors);

}  // namespace orbid::estimator
