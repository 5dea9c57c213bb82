#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/minimisation/error_parameter.hpp"

namespace orbid::estimator {

/// Whether average_information() tells the curvature over these error parameters: scales that alone divide records.
[[nodiscard]] bool has_average_information(const ErrorProblem& problem, const Eigen::VectorXd& psi,
                                           const std::vector<Eigen::Index>& free);

/// The average of observed and expected information on error scales, close to the second derivatives of Phi_psi near
/// its minimum for a factorisation instead of two or four evaluations for each scale:
///
///     2 w_k^T (I - S (S^T S)^-1 S^T) w_l
///
/// w: whitened errors at the minimum of the quadratic model, w_k those that scale k divides, S: rows of the integrated
/// states and parameters with the parameters' prior. Source: A. R. Gilmour, R. Thompson, B. R. Cullis, "Average
/// information REML", Biometrics 51 (1995) 1440. Of errors that are not normal w_k gets the length that the Fisher
/// information of its records asks for.
/// @param psi       where `standard` is.
/// @param standard  rows kept; what it has factorised is not needed.
/// @param step      to the minimum, see ErrorPoint.
/// @return shape (free, free), positive semidefinite.
[[nodiscard]] Eigen::MatrixXd average_information(const ErrorProblem& problem, const Eigen::VectorXd& psi,
                                                  WhitenedArrow standard, const ErrorStep& step,
                                                  const std::vector<Eigen::Index>& free);

}  // namespace orbid::estimator
