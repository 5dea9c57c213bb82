#pragma once

#include <memory>

#include <Eigen/Core>

namespace orbid::models {

/// P A = L U of a square matrix, shape (n, n), with partial pivoting. A singular matrix gives infinite or nan
/// solutions.
class LuFactor {
public:
    explicit LuFactor(const Eigen::MatrixXd& a);

    /// A^-1 b.
    [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;
    [[nodiscard]] Eigen::MatrixXd inverse() const;

private:
    struct Factor;
    std::shared_ptr<const Factor> factor_;
};

/// A^-1 of a square matrix.
[[nodiscard]] Eigen::MatrixXd inverse(const Eigen::MatrixXd& a);

/// The same without memory from the heap, for at most 4 rows.
using MatrixUpTo4 = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 4, 4>;
[[nodiscard]] MatrixUpTo4 inverse(const MatrixUpTo4& a);

}  // namespace orbid::models
