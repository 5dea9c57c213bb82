#pragma once

#include <Eigen/Core>

namespace orbid::estimator {

/// The parameter space split by what determines it: the data, the prior alone, nothing.
///
/// Steps are d = diag(1 / unit) V y with orthonormal V = [data | prior | flat], unit = norms of the sensitivity
/// columns.
struct Subspace {
    Eigen::VectorXd unit;   ///< shape (q)
    Eigen::MatrixXd data;   ///< shape (q, data rank)
    Eigen::MatrixXd prior;  ///< data-null directions on which the prior is curved
    Eigen::MatrixXd flat;   ///< directions that nothing decides
    Eigen::MatrixXd rows;   ///< the equilibrated matrix times `data`, shape (rows of r, data rank)

    /// Basis of all determined directions, in coordinates u: diag(1 / unit) [data | prior].
    [[nodiscard]] Eigen::MatrixXd decided() const;
};

/// Splits by the singular values of the equilibrated (unit columns) sensitivity matrix of the reduced problem. Where a
/// triangular one is far enough from singular that none can be small, `data` is the identity.
///
/// Equilibration makes the decision independent of units and sizes of parameters: only cancellation between columns
/// counts.
///
/// @param r          shape (any, q): whitened sensitivities of the reduced problem, without prior.
/// @param prior      square root of the curvature of -ln prior, shape (any, q): prior^T prior is the curvature.
/// @param fallback   shape (q), > 0: size of a parameter in u, sets the unit of a column that is zero.
/// @param tolerance  singular values below this fraction of the largest count as zero.
[[nodiscard]] Subspace split(const Eigen::MatrixXd& r, const Eigen::MatrixXd& prior, const Eigen::VectorXd& fallback,
                             double tolerance);

}  // namespace orbid::estimator
