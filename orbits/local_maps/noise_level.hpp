#pragma once

#include <Eigen/Core>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Errors of the readings of a section series, estimated from the series itself.
struct NoiseLevel {
    /// Of the error of one reading, shape (n, n), in the coordinates' units; positive definite. When not resolved it is
    /// an upper bound: all residuals of the local fits, taken as reading errors.
    Eigen::MatrixXd covariance;
    Eigen::VectorXd relative_error;  ///< standard error of each variance over the variance, shape (n); nan: a bound
    bool resolved = false;           ///< reading errors explain most of the local fits' residuals
};

/// Estimates the covariance S of the reading errors of a section series.
///
/// Around y_t a polynomial g is fitted to the nearest neighbours' images, y_t itself left out; r_t = y_{t+1} - g(y_t).
/// The error of y_{t+1} enters r_t as it is and r_{t+1} through the gradient A_{t+1} of g there, hence
///
///     E r_{t+1} r_t' = -A_{t+1} S,
///
/// exactly so for normal errors and any g (Stein's identity), even if the errors smooth or flatten g. Truncation errors
/// of g, which are not reading errors, enter only by their correlation from one point to the next. S is the
/// least-squares solution over up to 2^14 places, every r divided by the root of its local covariance. Order and number
/// of the neighbours are those with the smallest median residual. The standard error comes from 16 blocks of places.
///
/// On clean data S is not resolved; the bound is then the S for which S + A S A' has the size of the residuals.
/// Systematic errors as large as the distance over which the map bends cannot be detected.
///
/// @throws std::invalid_argument for fewer than 64 points with an image. Cost: 2^14 local fits for any length of the
/// series. Results are the same for any number of threads.
[[nodiscard]] NoiseLevel noise_level(const SectionPoints& points, const NeighbourIndex& grid);

}  // namespace orbid::orbits
