#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "orbits/local_maps/fit_choice.hpp"
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

/// Polynomials g fitted to the images of the nearest neighbours of points t, without t and its mirror image. Weights (1
/// - (d / radius)^2)^2 as in fit_local_map, normal equations (the digits of clean data below 1e-5 of the
/// neighbourhood's radius squared are lost).
///
/// @param places  points that have an image.
/// @param size    order 1 to 3.
[[nodiscard]] std::vector<CrossValidation> held_out_fits(const SectionPoints& points, const NeighbourIndex& grid,
                                                         const std::vector<std::size_t>& places, const FitSize& size);

/// Order and number of neighbours with the smallest median residual at some of the places: of those about as good, the
/// one with most neighbours. Empty: too few points for any.
[[nodiscard]] std::optional<FitSize> best_held_out_size(const SectionPoints& points, const NeighbourIndex& grid,
                                                        const std::vector<std::size_t>& places);

}  // namespace orbid::orbits
