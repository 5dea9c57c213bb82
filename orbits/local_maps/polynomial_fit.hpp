#pragma once

#include <Eigen/Core>

#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {

/// Weighted least squares of polynomials in the origin's neighbourhood, with error estimates from the data.
///
///     y_i = sum_m c_m (t_i)^m + error,   t_i = offset_i / radius,   weight (1 - |t_i|^2)^2
///
/// Modified Gram-Schmidt on the weighted design (backward stable for least squares; it also gives the rows of Q that
/// leave-one-out needs). Memory is reused from fit to fit: one object per thread.
class PolynomialFit {
public:
    /// Fits the first `k` rows.
    ///
    /// @param offsets  shape (>= k, n), nearest first, none longer than the radius.
    /// @param values   shape (>= k, r).
    /// @return false: fewer rows than coefficients + 2, or a direction lost to rounding; nothing else is meaningful.
    bool fit(const Monomials& monomials, int order, const Eigen::MatrixXd& offsets, const Eigen::MatrixXd& values,
             Eigen::Index k, double radius);

    /// Splits the residuals of the last fit into independent errors of the rows and a smooth remainder: random
    /// coefficients of the next two orders, the second half as large. With enough rows these orders are fitted too, and
    /// the part that independent errors would explain is subtracted. Otherwise each of the two is given all of the
    /// residuals.
    void part_residuals(const Monomials& monomials);

    [[nodiscard]] const Eigen::MatrixXd& coefficients() const { return coefficients_; }  ///< shape (count, r)

    /// Weighted rms of the residuals, corrected for the coefficients; over all columns.
    [[nodiscard]] double residual() const { return residual_; }
    /// Weighted rms of the errors of predicting every row from all others (leave-one-out); over all columns.
    [[nodiscard]] double left_out() const { return left_out_; }
    /// Weighted rms of the values about their weighted mean; over all columns.
    [[nodiscard]] double spread() const { return spread_; }
    /// Sum of squares by which independent errors of the rows enter the polynomial's value at the origin.
    [[nodiscard]] double leverage() const { return leverage_; }

    /// Products of the independent errors of one row, shape (r, r). After part_residuals.
    [[nodiscard]] const Eigen::MatrixXd& independent() const { return independent_; }
    /// Products of the remainder's coefficients (of the first of its two orders), shape (r, r). After part_residuals.
    [[nodiscard]] const Eigen::MatrixXd& remainder() const { return remainder_; }
    /// The fit of the remainder's columns, R^-1 Q^T W M, shape (count, remainder's columns). After part_residuals.
    [[nodiscard]] const Eigen::MatrixXd& remainder_response() const { return remainder_response_; }
    /// Predicted variance of the value at the origin, mean over the columns. After part_residuals.
    [[nodiscard]] double value_variance() const;

    [[nodiscard]] const Eigen::VectorXd& root_weights() const { return weight_; }  ///< shape (k)
    /// Q of the weighted design, shape (k, count).
    [[nodiscard]] const Eigen::MatrixXd& basis() const { return design_; }
    [[nodiscard]] const Eigen::MatrixXd& triangle() const { return triangle_; }  ///< R, shape (count, count)
    /// Weighted residuals, shape (k, r).
    [[nodiscard]] const Eigen::MatrixXd& residuals() const { return response_; }

private:
    /// Design to Q, triangle: R. @return false: a direction is lost to rounding.
    bool orthogonalise();
    /// Leverages and leave-one-out errors. @param total  of the weights.
    void predict_left_out(double total);

    int order_ = 0;
    Eigen::MatrixXd columns_, rest_, independent_, remainder_, remainder_response_;
    Eigen::MatrixXd scaled_, design_, triangle_, response_, projection_, coefficients_;
    Eigen::VectorXd weight_, influence_;
    Eigen::ArrayXd share_, value_influence_;
    double residual_ = 0.0, left_out_ = 0.0, spread_ = 0.0, leverage_ = 0.0;
};

}  // namespace orbid::orbits
