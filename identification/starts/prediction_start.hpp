#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_options.hpp"
#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

/// A start by prediction over one interval, and the residuals for the estimate that follows.
struct PredictionStart {
    Eigen::VectorXd theta;
    ProblemResiduals residuals;
};

/// Adds a residual of predictions over one interval per experiment: those of the series residual, or the one searched
/// for cycles. With "scan" the start is the best of a coarse ladder around the parameters' starts.
/// @param parameters  with the starts.
/// @param known       the start found here before; nullptr: none.
/// @throws orbits::DataError as add_shooting; also when a record has no interval that can be predicted.
[[nodiscard]] PredictionStart prediction_start(const IdentificationProblem& problem, const Options& options,
                                               const EstimateSetup& setup,
                                               const models::ParameterBinding& cycle_binding,
                                               const std::vector<estimator::FreeParameter>& parameters,
                                               const Eigen::VectorXd* known = nullptr);

/// Options of an estimate by predictions: it need only come near.
[[nodiscard]] estimator::EstimateOptions prediction_options(const estimator::EstimateOptions& options);

}  // namespace orbid::identification
