#pragma once

#include <Eigen/Core>

namespace orbid::estimator {

/// The smooth pieces of an objective that meet near a point, each by its gradient, and the step that decreases them
/// all:
///
///     p = -H^-1 sum lambda_i g_i,   lambda >= 0,  sum lambda_i = 1,   least p^T H p
///
/// g_i . p <= -p^T H p for every piece. Without such a step, p = 0, the point is a minimum of the piecewise objective:
/// to first order 0 is then in the convex hull of the gradients.
/// Source: C. Lemarechal, "An extension of Davidon methods to non differentiable problems", Mathematical Programming
/// Study 3 (1975), in the metric of H.
class GradientBundle {
public:
    /// @param hessian  H, shape (n, n), symmetric, positive semidefinite: directions without curvature are not moved.
    explicit GradientBundle(const Eigen::MatrixXd& hessian);
    /// @param gradient  shape (n)
    void add(const Eigen::VectorXd& gradient);
    [[nodiscard]] Eigen::Index size() const { return gradients_.cols(); }
    /// p, shape (n).
    [[nodiscard]] Eigen::VectorXd step() const;

private:
    Eigen::MatrixXd inverse_;    ///< of H, or its pseudo-inverse
    Eigen::MatrixXd gradients_;  ///< shape (n, pieces)
};

/// The point of least x^T Q x with x >= 0, sum x = 1; Q symmetric, positive semidefinite, shape (n, n), n >= 1. To
/// 1e-12 of the largest |Q_ij|.
[[nodiscard]] Eigen::VectorXd least_convex_combination(const Eigen::MatrixXd& q);

}  // namespace orbid::estimator
