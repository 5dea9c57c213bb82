#pragma once

#include <memory>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Closing errors linearised in all nodes, and the normal equations for short corrections that bring them to zero:
///
///     r + J d,   A = W + weight J^T J
///
/// J holds dF_j / dz_j beside -1, the derivatives by all nodes (and by ln T behind them). Rows and columns are in units
/// of the scales. Shape (d N, d N + k), sparse; W is diagonal.
class ClosingEquations {
public:
    /// @param own_weights  diagonal of W, shape (d N + k), > 0 or such that A is regular; empty: 1.
    ClosingEquations(const ClosingError& closing, const VectorXd& scale, double weight,
                     const VectorXd& own_weights = {});
    ~ClosingEquations();

    [[nodiscard]] bool regular() const;  ///< A was factorised
    /// J^T r.
    [[nodiscard]] VectorXd pulled(const VectorXd& r) const;
    [[nodiscard]] MatrixXd pulled(const MatrixXd& r) const;
    /// weight J^T r.
    [[nodiscard]] VectorXd weighted_pull(const VectorXd& r) const;
    /// A^-1 b; only where regular.
    [[nodiscard]] VectorXd solve(const VectorXd& b) const;
    [[nodiscard]] MatrixXd solve(const MatrixXd& b) const;

private:
    struct Factor;
    std::unique_ptr<Factor> factor_;
};

}  // namespace orbid::periodic
