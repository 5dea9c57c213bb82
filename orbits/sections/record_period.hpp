#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// The period of a sampled record, told from nothing but its readings.
struct RecordPeriod {
    bool periodic = false;  ///< the record repeats: everything else is meaningful without it, as the nearest to one
    double time = 0.0;      ///< T [s]; 0: no lag at which the record comes back to itself
    /// Root mean square of (y(t + T) - y(t)) / sqrt 2 over the sd of the readings, in [0, 1]: 1 without any repetition.
    double distance = 1.0;
    double noise = 0.0;  ///< what the errors of the samples alone would give, likewise
    int maxima = 0;      ///< maxima per period of the coordinate `of`, as many as a return map has points
    Eigen::Index of = 0;
    double periods = 0.0;  ///< that the longest segment lasts
};

/// Looks for the lag T at which
///
///     D(T) = < (y(t + T) - y(t))^2 > / (2 var y),      averaged over time, and over the coordinates
///
/// is least. At integer lags D needs no interpolation; its minima are those of polynomials through five lags,
/// and multiples of T, as far as the record reaches, make T more accurate. Of all minima that are as deep as the
/// deepest one within a half, the first is T: a period-doubled motion returns to less than that at half of its period
/// only when the errors of the readings hide the difference. The record is called periodic if the rms distance is below
/// a fifth of the sd of the readings, or below twice the noise, and T fits in twice.
///
/// Maxima are counted on the mean of all periods of the longest segment, between reversals by a hundredth of the range
/// or six sds of that mean, whichever is more.
///
/// Pairs are thinned to 4096 instants; T is at most half of the longest segment and 20 000 samples. Missing samples are
/// left out; angles differ modulo a turn.
///
/// @param coordinates  indices; empty: all
/// @param segments     indices; empty: all
/// @throws std::invalid_argument for sections and indices out of range; DataError for samples that are not
///         equidistant.
[[nodiscard]] RecordPeriod record_period(const Series& samples, std::span<const Eigen::Index> coordinates = {},
                                         std::span<const std::size_t> segments = {});

/// "repeats after 1.7195 s, with 5 maxima of x, 20 times; distance 0.5 % of the sd of the readings". For logs.
[[nodiscard]] std::string description(const RecordPeriod& period, const Series& samples);

}  // namespace orbid::orbits

#pragma GCC visibility pop
