#pragma once

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// Moves draws of a posterior with independent errors to where the sandwich of the estimate says they belong:
///
///     u* = u_0 + C^(1/2) H^(1/2) (u - u_0)
///
/// in the coordinates u, u_0 = the estimate, C = covariance of the sandwich, H^-1 = Laplace's covariance. The draws
/// then have the sds and correlations of the table; their shape remains. Places beyond a bound are brought back to it.
/// Source: Ribatet, Cooley and Davison, Statist. Sinica 22 (2012) 813 (curvature adjustment), applied to the draws as
/// by Shaby, J. Comput. Graph. Statist. 23 (2014) 853.
class SandwichMap {
public:
    /// @param laplace  of u, shape (parameters, parameters)
    SandwichMap(const Problem& problem, const Estimate& estimate, const Eigen::MatrixXd& laplace);

    [[nodiscard]] bool moves() const { return map_.size() > 0; }  ///< false: sds are those of Laplace
    [[nodiscard]] Eigen::VectorXd operator()(const Eigen::VectorXd& u) const;

private:
    Eigen::VectorXd centre_;
    Eigen::VectorXd lower_;
    Eigen::VectorXd upper_;
    Eigen::MatrixXd map_;
};

}  // namespace orbid::estimator
