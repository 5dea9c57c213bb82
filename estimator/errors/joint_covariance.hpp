#pragma once

#include <Eigen/Core>

#include "estimator/errors/noise_model.hpp"

namespace orbid::estimator {

/// L of V = L L^T, shape (m, m), from the log-Cholesky coordinates in psi (of the whole estimate).
[[nodiscard]] Eigen::MatrixXd covariance_root(const NoiseModel& law, const Eigen::VectorXd& psi);

/// The log-Cholesky coordinates of L, shape (m (m + 1) / 2); the inverse of covariance_root().
[[nodiscard]] Eigen::VectorXd root_coordinates(const Eigen::MatrixXd& lower);

/// d V / d psi, shape (m * m, m (m + 1) / 2): V column by column.
[[nodiscard]] Eigen::MatrixXd covariance_slopes(const NoiseModel& law, const Eigen::VectorXd& psi);

}  // namespace orbid::estimator
