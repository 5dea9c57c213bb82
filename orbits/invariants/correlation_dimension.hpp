#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct CorrelationOptions {
    /// Pairs nearer in time than this many points are left out (Theiler 1986): they are near because they follow each
    /// other, not because of the attractor's shape. 0: 10 for sections. For flows ten times the samples in which the
    /// state moves a tenth of its range.
    std::size_t theiler = 0;
    /// Target number of pairs per octave of distances, in [10^4, 10^9]; about ten times as many are examined.
    std::size_t pairs = 1'000'000;
    /// Largest number of points among which pairs are sought, >= 1000, evenly spread over a longer series.
    std::size_t points = 200'000;
    std::function<bool()> interrupted = {};  ///< asked all along; if it says so, models::Stopped is thrown
};

/// Statistics of pairs nearer than a radius.
struct CorrelationScale {
    double radius = 0.0;     ///< r in units of Series::scale()
    std::size_t points = 0;  ///< among which the pairs were sought
    std::size_t pairs = 0;   ///< nearer than r
    double sum = 0.0;        ///< C(r), their share
    double slope = 0.0;      ///< d ln C / d ln r between r and r / sqrt 2
    double slope_sd = 0.0;
    double entropy = 0.0;  ///< K2 from pairs that stay within r, per step; nan if too few
};

/// Correlation dimension and entropy of a measured set.
struct CorrelationDimension {
    double dimension = 0.0;  ///< mean slope over the scaling range; nan: no such range
    double sd = 0.0;         ///< statistics and scatter of the slopes over that range
    double takens = 0.0;     ///< Takens' estimator with the scaling range's largest radius as cutoff
    double takens_sd = 0.0;
    double largest_radius = 0.0, smallest_radius = 0.0;  ///< the scaling range, units of Series::scale()
    double entropy = 0.0;  ///< K2 <= the sum of the positive Lyapunov exponents, per section, or per second when timed
    double entropy_sd = 0.0;
    bool timed = false;
    std::size_t theiler = 0;
    std::vector<CorrelationScale> scales;  ///< from large to small radii, half an octave apart
    std::vector<std::string> remarks;
};

/// Correlation integral over distances in the largest-coordinate norm (Grassberger and Procaccia 1983):
///
///     C(r) = share of pairs |i - j| > theiler with |x_i - x_j| < r  ~  r^D2,   D2 = d ln C / d ln r
///     Takens 1985:  D = 1 / < ln(r0 / |x_i - x_j|) > over pairs nearer than r0
///     C_m(r), pairs that stay within r for m steps  ~  e^(-K2 m)
///
/// Reading errors fill all dimensions below their size. A scaling range with slopes near the number of coordinates is
/// therefore skipped when one with smaller slopes exists at larger radii; a remark says so.
///
/// Each octave of r uses all pairs among evenly spread points, just enough for the target number of pairs. Pairs are
/// found by boxes of edge r; the cost per octave is constant until all points are in use. The scaling range is the
/// longest run of slopes without drift that scatter by less than 4 % beyond their errors. It spans at least two
/// octaves, below a tenth of the range. Errors come from leaving out each of 16 stretches of the series in turn. Slopes
/// of Cantor sets oscillate about D2. Those of sets with singular densities converge slowly (logistic map at 4: like
/// 1 / ln r from below): see `scales`.
///
/// @throws std::invalid_argument for options out of range; DataError for fewer than 1000 points;
///         as SectionPoints.
[[nodiscard]] CorrelationDimension correlation_dimension(const Series& series, const CorrelationOptions& options = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
