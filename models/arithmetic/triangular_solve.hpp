#pragma once

#include <Eigen/Core>

namespace orbid::models {

/// Solutions with triangular matrices R (upper) and L (lower), shape (n, n); the other half is not read. Vectors and
/// matrices use different kernels with different rounding. One column is solved for as a vector.

/// x becomes R^-1 x.
void solve_upper_in_place(const Eigen::Ref<const Eigen::MatrixXd>& r, Eigen::VectorXd& x);
void solve_upper_in_place(const Eigen::Ref<const Eigen::MatrixXd>& r, Eigen::MatrixXd& x);

/// x becomes R^-T x.
void solve_transposed_upper_in_place(const Eigen::Ref<const Eigen::MatrixXd>& r, Eigen::VectorXd& x);
void solve_transposed_upper_in_place(const Eigen::Ref<const Eigen::MatrixXd>& r, Eigen::MatrixXd& x);

/// x becomes L^-1 x.
void solve_lower_in_place(const Eigen::Ref<const Eigen::MatrixXd>& l, Eigen::VectorXd& x);
void solve_lower_in_place(const Eigen::Ref<const Eigen::MatrixXd>& l, Eigen::MatrixXd& x);

/// x becomes x R^-1.
void divide_by_upper_in_place(Eigen::MatrixXd& x, const Eigen::Ref<const Eigen::MatrixXd>& r);

}  // namespace orbid::models
