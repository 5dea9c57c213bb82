#pragma once

#include <Eigen/Core>

namespace orbid::orbits {

/// The value at a place of a polynomial through values at points near it.
struct LocalPolynomial {
    Eigen::VectorXd value;           ///< at the place, shape (m)
    Eigen::MatrixXd slope;           ///< shape (m, n), per unit of the offsets
    Eigen::MatrixXd residual;        ///< covariance of the values' residuals, shape (m, m)
    Eigen::VectorXd weights;         ///< of the single values in `value`, shape (k)
    double leverage = 0.0;           ///< variance of `value` for unit variance of independent errors of the values
    Eigen::VectorXd slope_leverage;  ///< the same of the columns of `slope`, shape (n)
    bool usable = false;             ///< false: fewer points than coefficients + 2, or points without n dimensions
};

/// Weighted least squares, weights (1 - (d / radius)^2)^2 on the squares, orthogonal factorisation in units of the
/// radius, values about their mean.
///
/// With normal errors of the places the fit gives values averaged over them, F smeared = F + (b / 2) laplace F + ...
/// for errors of variance b in every direction. `blur` = b removes that term from the value and the slope:
///
///     F(0) = c_0 - b sum_a c_aa,   dF/dt_a = c_a - b (3 c_aaa + sum_b c_abb),
///
/// with the coefficients c of the polynomial (quadratic ones need order 2, cubic ones 3).
///
/// @param offsets  shape (k, n): points minus place, all within the radius.
/// @param values   shape (k, m).
/// @param order    1 to 3.
[[nodiscard]] LocalPolynomial fit_local_polynomial(const Eigen::MatrixXd& offsets, const Eigen::MatrixXd& values,
                                                   double radius, int order, double blur = 0.0);

}  // namespace orbid::orbits
