#pragma once

#include <Eigen/Core>

namespace orbid::orbits {

/// The covariance, made symmetric, with its diagonal raised by 1e-9 of its largest eigenvalue and by the variance of
/// rounding (scaled units): factorisations then work even where halves of a cycle are exactly dependent.
[[nodiscard]] Eigen::MatrixXd floored_covariance(const Eigen::MatrixXd& covariance);

}  // namespace orbid::orbits
