#pragma once

#include <cstddef>

#include <Eigen/Core>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Prediction of a point's image from those of its neighbours.
struct CrossValidation {
    Eigen::VectorXd residual;    ///< y_{t+1} - g(y_t), shape (n), scaled units
    Eigen::MatrixXd gradient;    ///< of g at y_t, shape (n, n)
    Eigen::MatrixXd covariance;  ///< of the neighbours' residuals, shape (n, n); positive definite
    bool usable = false;         ///< false: too few neighbours, or their images tear apart on a circle
};

/// Fits a polynomial g to the images of the k nearest neighbours of point t, without t and its mirror image. Weights (1
/// - (d / radius)^2)^2 as in fit_local_map, normal equations (the digits of clean data below 1e-5 of the
/// neighbourhood's radius squared are lost).
///
/// @param t      has_image(t).
/// @param order  1 to 3.
[[nodiscard]] CrossValidation held_out_fit(const SectionPoints& points, const NeighbourIndex& grid, std::size_t t,
                                           int order, std::size_t k);

}  // namespace orbid::orbits
