#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "orbits/local_maps/cycle_multiplier.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// The map near a point x_t of the series, relative to it:  A (y_t - x_t) = y_{t+1} - x_{t+1}  (P5).
///
/// Linear and without intercept: the reference and its image are taken as exact.
struct ReferenceMap {
    Eigen::MatrixXd jacobian;   ///< A, shape (n, n)
    Eigen::MatrixXd offsets;    ///< shape (k, n): neighbour - reference, nearest first, scaled units
    Eigen::MatrixXd residuals;  ///< shape (k, n): image - image of the reference - A offset
    Eigen::MatrixXd solver;     ///< shape (n, k): transposed jacobian = solver * images
    double residual = 0.0;      ///< rms over all coordinates, corrected for the n fitted slopes, scaled units
    double image_spread = 0.0;  ///< rms of the images about their mean, scaled units
    /// Residual rms of a cubic map with intercept (quadratic with few neighbours): reading errors without the
    /// truncation of the linear map and without the reference's own error. Equal to `residual` with too few for either.
    double curved_residual = 0.0;
    /// Part of the squared residuals of a linear map with intercept that curved terms explain, 0 to 1: the truncation.
    /// 1 with too few neighbours to decide.
    double truncation = 1.0;
    double return_time = std::numeric_limits<double>::quiet_NaN();  ///< [s] of the reference; nan: the series has none
    Eigen::VectorXd
        time_slope;  ///< of the return time at the reference [s per scaled unit], shape (n); empty: no times
    double time_residual = 0.0;  ///< rms residual of the neighbours' return times [s]
    bool usable = false;         ///< false: fewer neighbours than n + 2, or neighbours without n dimensions
};

/// Least squares fit about point `reference` of the series, which must have an image, to at most `most` nearest
/// neighbours, none farther away than `ball` (Euclidean, scaled units).
///
/// Neighbours whose images tear apart on a circle are dropped: from the first (nearest first) whose image lies a
/// quarter turn or more from the reference's.
[[nodiscard]] ReferenceMap fit_reference_map(const SectionPoints& section, const NeighbourIndex& grid,
                                             std::size_t reference, double ball, std::size_t most);

/// Errors of a cycle closed with reference maps, scaled units.
struct ReferenceErrors {
    Eigen::MatrixXd covariance;  ///< of all points, shape (n p, n p), coordinate fastest
    CycleMultipliers multipliers;
    Eigen::MatrixXd ln_multiplier_covariance;                   ///< shape (n, n)
    double time_sd = std::numeric_limits<double>::quiet_NaN();  ///< [s] of the cycle's time; nan: the series has none
};

/// Covariance of a cycle whose points are x_{t+j} + u_j,  u_{j+1} = A_j u_j,  closed by the return x_{t+p} (P8).
///
/// Reading errors e_j of the p + 1 points of the piece, independent with covariance Sigma, move the cycle by
/// A_j (du_j - e_j) ...: for the first point that is (M6),
///
///     Cov(x_0) = (I - A^p)^-1 (Sigma + A^p Sigma A^pT) (I - A^p)^-T.
///
/// Errors of the fits are added at the cycle's point, u_j from the reference. They are independent errors of the
/// neighbours and the reference, as large as the curved maps' residuals, and a smooth remainder (random quadratic and
/// cubic terms) that explains the truncation in the linear fit's residuals.
///
/// @param maps     p of them, in order.
/// @param offset   u, shape (n p).
/// @param inverse  of coupled_matrix() of the jacobians, shape (n p, n p).
/// @param reading_covariance  Sigma in scaled units, shape (n, n); empty: equal in all coordinates, as large as the
///                            residuals of curved maps.
[[nodiscard]] ReferenceErrors reference_errors(const std::vector<ReferenceMap>& maps, const Eigen::VectorXd& offset,
                                               const Eigen::MatrixXd& inverse,
                                               const Eigen::MatrixXd& reading_covariance);

}  // namespace orbid::orbits
