#pragma once

#include <unordered_map>

#include <Eigen/Core>

#include "orbits/spline_map/reading_smoother.hpp"
#include "orbits/spline_map/spline_basis.hpp"

namespace orbid::orbits {

/// What patches cannot represent (kinks, folds narrower than a patch): a variance per coordinate and region, from the
/// part of the residuals that reading errors do not explain.
class PatchModelError {
public:
    /// @param smallest  shape (n): variances never fall below, scaled units.
    explicit PatchModelError(Eigen::VectorXd smallest);

    /// Variances of a region, shape (n).
    [[nodiscard]] const Eigen::VectorXd& variance(const SplineBasis& basis, const double* place) const;

    /// One step towards the most likely variances:  q2 <- q2 sum u^2 / sum (V^-1)_tt, with u = V^-1 r, as long as the
    /// excess is beyond two standard errors; otherwise the variance falls to the smallest. Steps with u = 0 are
    /// ignored.
    ///
    /// @param places    shape (n, steps).
    /// @param weighted  u, shape (n, steps).
    void update(const SplineBasis& basis, const Eigen::MatrixXd& places, const Eigen::MatrixXd& weighted,
                const ReadingSmoother& smoother);

private:
    Eigen::VectorXd smallest_;
    std::unordered_map<std::int64_t, Eigen::VectorXd> variance_;
};

}  // namespace orbid::orbits
