#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include "orbits/spline_map/difference_rows.hpp"
#include "orbits/spline_map/spline_basis.hpp"

namespace orbid::orbits {

/// How rough one coordinate of a patch map may be: a normal prior on the third differences of its coefficients,
///
///     -ln prior = 1/2 c' P c,    P = sum over differences of weight(region) row' row
///
/// with one weight per region of the section, found from the data. The weight is small where the map folds; where it is
/// smooth, neighbours share their data. The covariance of the coefficients then includes what the patches do not
/// resolve. Quadratic maps have no roughness.
class SplineRoughness {
public:
    /// @param d  the coordinate, of the image.
    SplineRoughness(const SplineBasis& basis, Eigen::Index d);

    void set_weight(double weight) { weight_.assign(weight_.size(), weight); }
    void scale_weight(double factor);
    /// P added to a dense row-major matrix over the unknowns.
    void add_to(std::vector<double>& matrix) const;
    /// P c.
    [[nodiscard]] Eigen::VectorXd times(const Eigen::VectorXd& c) const;
    /// One step towards the weights that make the data most likely: the mean square of a region's differences is that
    /// of their estimates plus their uncertainty.
    ///
    /// @param root      K of the covariance K' K variance of c, from the present weights (relative to `variance`).
    /// @param least     variance of differences that are as good as none: weights end there.
    /// @return effective number of coefficients.
    /// Source: Fellner (1986) and Schall (1991), for variances of random effects; the total of a region's independent
    /// differences is shared evenly.
    double reweigh(const std::vector<double>& root, const Eigen::VectorXd& c, double variance, double least,
                   const std::function<bool()>& interrupted);

private:
    Eigen::Index unknowns_;
    DifferenceRows rows_;
    std::vector<std::size_t> region_;  ///< of every row
    std::vector<double> rank_;         ///< independent differences of a region
    std::vector<double> weight_;       ///< of a region
};

}  // namespace orbid::orbits
