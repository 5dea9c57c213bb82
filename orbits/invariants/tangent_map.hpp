#pragma once

#include <cstddef>

#include <Eigen/Core>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "orbits/local_maps/monomials.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// The derivative of the section map at a point of the series, fitted to the images of its neighbours for products of
/// many derivatives: directions that the neighbours do not span give zero instead of noise.
struct TangentMap {
    Eigen::MatrixXd jacobian;       ///< shape (n, n), scaled units
    double prediction_error = 0.0;  ///< |predicted - true image of the point|, which is not in the fit
    double residual = 0.0;          ///< weighted rms of the residuals per coordinate
    double attenuation = 0.0;       ///< share by which such reading errors in the neighbours' places lower the slope
    double image_spread = 0.0;      ///< weighted rms of the images about their mean, per coordinate
    bool usable = false;
};

/// Fits tangent maps; holds the work space, so one per thread.
///
/// Weighted least squares of a polynomial with intercept, weights (1 - (d / radius)^2)^2, by orthogonal factorisation.
/// Directions in the space of coefficients along which the neighbours spread no more than the fit errs are left out
/// (complete orthogonal decomposition, solution of smallest norm). Attractors of strongly contracting systems are
/// curves or sheets thinner than that error: the slope across them would otherwise be arbitrary.
///
/// Neighbours whose images lie beyond a tear of the section are left out: a gap wider than half the range of the
/// images along their longest direction.
class TangentFitter {
public:
    /// Keeps references. @param order  1 to 4. @param neighbours  at least the number of coefficients + 2.
    TangentFitter(const SectionPoints& points, const NeighbourIndex& grid, int order, std::size_t neighbours);

    /// At point i of the series, has_image(i); the point itself is not among its neighbours.
    [[nodiscard]] const TangentMap& fit(std::size_t i);

    /// sd of every coordinate of the image of a direction, by the residuals of the last usable fit; for directions left
    /// out by the spread of the images.
    [[nodiscard]] double image_sd(const Eigen::VectorXd& direction) const;

private:
    void gather(std::size_t i, std::size_t wanted);
    bool drop_torn();
    void fill_design();
    void solve();

    const SectionPoints* points_;
    const NeighbourIndex* grid_;
    std::size_t neighbours_;
    Monomials monomials_;
    Eigen::Index count_ = 0;  ///< of members in use
    double radius_ = 0.0;
    Eigen::MatrixXd offsets_, images_;  ///< shape (k, n), first count_ rows; images relative to the point's own
    Eigen::VectorXd weights_;
    Eigen::MatrixXd design_, response_, triangle_, fitted_;
    models::HouseholderFactor factor_;
    models::CompleteFactor orthogonal_;
    bool truncated_ = false;  ///< the fit is that of orthogonal_
    TangentMap map_;
};

}  // namespace orbid::orbits
