#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/minimisation/error_parameter.hpp"

namespace orbid::estimator {

/// Fixed-point steps of (M10) for the free error parameters: of each law by itself, and of all plain scales together.
[[nodiscard]] std::vector<Eigen::VectorXd> far_steps(const ErrorProblem& problem, const ErrorPoint& point,
                                                     const Eigen::VectorXd& psi, const std::vector<Eigen::Index>& free);

}  // namespace orbid::estimator
