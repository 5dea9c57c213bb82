#pragma once

#include <cstddef>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "apps/report/plots/record_charts.hpp"

/// What is left of sampled records after an estimate, and what it depends on. White noise depends on nothing.
namespace orbid::apps {

/// Autocorrelation of the residuals of a group over their sds, from lag 0 on:
///
///     r_k = (n / n_k) sum e_i e_j / sum e_i^2,   e over the pairs (i, j) of a segment that are k samples apart,
///
/// e with the mean of the group taken off, n_k the number of pairs. Pairs across a gap are left out.
/// @return empty for fewer than 20 residuals, or samples at their own times
[[nodiscard]] std::vector<double> autocorrelation_of(const RecordGroup& group, std::size_t lags);

/// The lags of each group beside the band that holds 95 % of those of white noise, +-1.96 / sqrt(n).
/// @param groups  with all rows: record_groups(run, rows, rows.size())
[[nodiscard]] Chart autocorrelation_chart(const std::vector<RecordGroup>& groups);

/// Power of the residuals over frequency, 1 for white noise: the cosine transform of their autocorrelation under
/// Parzen's window (Blackman and Tukey), with the band that holds 95 % of the values of white noise.
/// @param groups  as of autocorrelation_chart
/// Source: G. M. Jenkins, D. G. Watts, Spectral Analysis and its Applications (1968), section 6.3.
[[nodiscard]] Chart spectrum_chart(const std::vector<RecordGroup>& groups);

/// Residuals over their sd against what they should not depend on: each measured input, each coordinate that was read
/// (as predicted), and its rate of change (by differences of the prediction). Dots of a few hundred readings, and the
/// means of all of them in groups of equal size with twice their standard error.
[[nodiscard]] Chart dependence_chart(const StoredRun& run, const std::vector<RecordGroup>& groups);

/// Segments that were predicted, not fitted: measured, predicted, and the error, with its rms.
/// @param groups  of predictions.csv
[[nodiscard]] Chart segment_chart(const std::vector<RecordGroup>& groups);

}  // namespace orbid::apps
