#pragma once

#include <vector>

#include <Eigen/Core>

#include "apps/results/result_file.hpp"
#include "apps/stages/workspace.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps {

/// Follows the model's branch at an estimate from measured motions and stores it with them: branch.json, branch.csv and
/// branch.svg, or estimate_branch.* where "continuation" has a branch of its own.
/// @param active  the residual's at the estimate `theta`
/// @param rows    of residuals.csv, those of the residual
/// @param context with the steady states of the residual
void store_fitted_branch(const Workspace& work, const identification::IdentificationProblem& problem,
                         const identification::EstimateSetup& setup, const periodic::BranchResidual& residual,
                         const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                         const std::vector<ResidualRow>& rows, const ResultContext& context);

}  // namespace orbid::apps
