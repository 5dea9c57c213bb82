#pragma once

#include <Eigen/Core>

namespace orbid::models {

/// A = U diag(values) V^T.
struct SingularValues {
    Eigen::MatrixXd u;       ///< left singular vectors in columns; empty unless asked for
    Eigen::VectorXd values;  ///< descending
    Eigen::MatrixXd v;       ///< right singular vectors in columns
};

/// Which singular vectors of a matrix of shape (m, n) are computed; k = min(m, n).
enum class SingularVectors {
    thin,  ///< u of shape (m, k), v of shape (n, k)
    full,  ///< u of shape (m, m), v of shape (n, n)
    right  ///< v of shape (n, n) alone
};

[[nodiscard]] SingularValues singular_value_decomposition(const Eigen::MatrixXd& a, SingularVectors vectors);

/// Singular values, descending, without the vectors.
[[nodiscard]] Eigen::VectorXd singular_values(const Eigen::MatrixXd& a);

}  // namespace orbid::models
