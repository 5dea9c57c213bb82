#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "orbits/local_maps/monomials.hpp"
#include "orbits/local_maps/polynomial_fit.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Neighbours of a place and their images, as differences without wrapping.
struct Neighbourhood {
    Eigen::VectorXd centre;     ///< shape (n), scaled units
    Eigen::VectorXd reference;  ///< shape (n): image of the nearest neighbour; images are unwrapped relative to it
    Eigen::MatrixXd offsets;    ///< shape (k, n): neighbour - centre
    Eigen::MatrixXd images;     ///< shape (k, n): image of the neighbour - reference
    double radius = 0.0;        ///< just beyond the farthest neighbour, scaled units; weights vanish there
    std::vector<Neighbour> members;
};

/// Gathers the k nearest neighbours of a place with their images (mirrored copies included).
///
/// Neighbours whose images tear apart on a circle are dropped: from the first (nearest first) whose image lies a
/// quarter turn or more from the nearest neighbour's. `offsets` has fewer than k rows then.
[[nodiscard]] Neighbourhood gather_neighbourhood(const SectionPoints& points, const NeighbourIndex& grid,
                                                 const Eigen::VectorXd& centre, std::size_t k);

/// The map near a place, fitted to data, a polynomial of order 1 to 6 (P5 with intercept and curvature):
///
///     F(c + d) = reference + sum_m b_m (d / radius)^m = value + A d + ...
struct LocalMap {
    Eigen::VectorXd centre;    ///< c, shape (n)
    Eigen::VectorXd value;     ///< F(c), shape (n), wrapped
    Eigen::MatrixXd jacobian;  ///< A, shape (n, n)
    int order = 0;
    Eigen::MatrixXd coefficients;  ///< b, shape (n, count), monomials as in Monomials, the constant included
    std::shared_ptr<const Monomials> monomials;
    double radius = 0.0;    ///< of the neighbourhood
    double residual = 0.0;  ///< weighted rms of the residuals over all coordinates, scaled units
    double left_out = 0.0;  ///< the same for predictions of every neighbour from all others
    /// Predicted error of the value, rms over the coordinates: independent errors and truncation, as separated by
    /// PolynomialFit::part_residuals. Without tables of two more orders, `left_out` as independent errors only.
    double value_sd = 0.0;
    double image_spread = 0.0;  ///< weighted rms of the images about their mean, scaled units
    bool usable = false;        ///< false: too few neighbours or a neighbourhood without n dimensions

    /// F(c + d) - F(c), shape (n).
    [[nodiscard]] Eigen::VectorXd displacement(const Eigen::VectorXd& d) const;
    /// dF/dd at c + d, shape (n, n).
    [[nodiscard]] Eigen::MatrixXd jacobian_at(const Eigen::VectorXd& d) const;
};

/// Weighted least squares fit to the nearest k neighbours with intercept, weights (1 - (d / radius)^2)^2 on the squared
/// residuals.
///
/// In units of the radius. Exact for polynomial maps of the order.
/// @param order  1 to 6.
/// @param monomials, workspace  tables of this order at least, and memory, kept between fits.
/// @return usable = false with fewer neighbours than coefficients + 2, or rank lost to rounding.
[[nodiscard]] LocalMap fit_local_map(const SectionPoints& points, const Neighbourhood& neighbourhood, int order,
                                     std::size_t k, const std::shared_ptr<const Monomials>& monomials,
                                     PolynomialFit& workspace);

/// Covariance of the errors of (value, jacobian) of a fit, shape (n (1 + n), n (1 + n)), order: value (n), then the
/// columns of the jacobian.
///
/// Two models of the residuals, each scaled to explain them, are added. One is independent errors (reading noise,
/// rounding). The other is a smooth remainder, random coefficients of the next two orders (truncation: it does not
/// average out and is largest where the neighbours lie to one side). The neighbours' places have reading errors too.
/// Through the curvature their variance shifts the value, and their spread attenuates the jacobian; both shifts are
/// added squared.
/// @param most  neighbours that the fit used; the others of the neighbourhood are left out.
[[nodiscard]] Eigen::MatrixXd local_map_covariance(const Neighbourhood& neighbourhood, const LocalMap& map,
                                                   std::size_t most = std::numeric_limits<std::size_t>::max());

/// The covariance, made symmetric, with its diagonal raised by 1e-9 of its largest eigenvalue and by the variance of
/// rounding (scaled units): factorisations then work even where halves of a cycle are exactly dependent.
[[nodiscard]] Eigen::MatrixXd floored_covariance(const Eigen::MatrixXd& covariance);

}  // namespace orbid::orbits
