#pragma once

#include <Eigen/Core>

namespace orbid::models {

/// A = V diag(values) V^T.
struct SymmetricEigen {
    Eigen::VectorXd values;   ///< ascending
    Eigen::MatrixXd vectors;  ///< orthonormal columns
};

/// Eigenvalues and eigenvectors of a symmetric matrix, shape (n, n); its lower triangle is read. For a matrix that is
/// not finite the result is not finite or meaningless; nothing is thrown.
[[nodiscard]] SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& a);

/// Eigenvalues of a symmetric matrix, ascending, without the vectors.
[[nodiscard]] Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& a);

/// Eigenvalues of a square matrix in the order the QR iteration finds them; complex ones in pairs of conjugates.
[[nodiscard]] Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& a);

}  // namespace orbid::models
