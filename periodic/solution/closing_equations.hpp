#pragma once

#include <memory>

#include <Eigen/Core>

#include "periodic/discretisation/closing_error.hpp"

namespace orbid::periodic {

/// Closing errors linearised in all nodes, and the normal equations for short corrections that bring them to zero:
///
///     r + J d,   A = W + weight J^T J
///
/// J holds dF_j / dz_j beside -1, the derivatives by all nodes (and by ln T behind them). Rows and columns are in units
/// of the scales. Shape (d N, d N + k), sparse; W is diagonal.
class ClosingEquations {
public:
    /// @param own_weights  diagonal of W, shape (d N + k), > 0 or such that A is regular.
    ClosingEquations(const ClosingError& closing, const Eigen::VectorXd& scale, double weight,
                     const Eigen::VectorXd& own_weights);
    /// The same with W = 1.
    ClosingEquations(const ClosingError& closing, const Eigen::VectorXd& scale, double weight);
    ~ClosingEquations();

    [[nodiscard]] bool regular() const;  ///< A was factorised
    /// J^T r.
    [[nodiscard]] Eigen::VectorXd pulled(const Eigen::VectorXd& r) const;
    [[nodiscard]] Eigen::MatrixXd pulled(const Eigen::MatrixXd& r) const;
    /// weight J^T r.
    [[nodiscard]] Eigen::VectorXd weighted_pull(const Eigen::VectorXd& r) const;
    /// A^-1 b; only where regular.
    [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;

private:
    struct Factor;
    std::unique_ptr<Factor> factor_;
};

}  // namespace orbid::periodic
