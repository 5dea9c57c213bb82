#pragma once

#include <string>

#include <Eigen/Core>

#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// What is told of a direction. Simple powers of positive values are a product on whatever scale they are estimated.
/// @param size        of each parameter: the change in natural units that a component of 1 stands for.
/// @param components  relative changes, largest 1, shape (parameters).
[[nodiscard]] std::string told_of(const Problem& problem, const State& state, const Eigen::VectorXd& size,
                                  const Eigen::VectorXd& components);

}  // namespace orbid::estimator
