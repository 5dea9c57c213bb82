#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "apps/results/result_file.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"
#include "identification/problem/identification_problem.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps {

/// Results of an estimate by record and segment, read back from its residuals.

/// One row per coordinate of every point of the cycles used; times as phase of the forcing [rad].
/// @param values  of the estimate, one per block of `residual`; lost cycles (empty) are left out.
void add_cycle_rows(const Workspace& work, const orbits::CycleResidual& residual, const estimator::ActiveSet& active,
                    const orbits::CycleSearch& search, const estimator::Estimate& estimate,
                    const std::vector<estimator::BlockValue>& values, std::vector<ResidualRow>& rows);

/// One row per reading of the fitted segments, in time order.
/// @param experiment  index into Job::data.
/// @throws models::Stopped
void add_series_rows(const Workspace& work, std::size_t experiment, const orbits::SeriesResidual& residual,
                     const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                     std::vector<ResidualRow>& rows);

/// Initial state of every fitted segment; fixed values have no sd.
/// @param parameters    by coordinate: indices of parameters that are its value in each block, or empty.
/// @param latents, sds  of the estimate, one per block; `sds` may be empty.
void add_initial_states(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                        const estimator::Estimate& estimate, const std::vector<std::vector<Eigen::Index>>& parameters,
                        const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                        ResultContext& context);

/// One row per reading of the fitted segments, in time order; both readings of the angle for a difference sensor. Times
/// of sections are phases of the forcing [rad] if the record has no times.
/// @throws models::Stopped
void add_shooting_rows(const Workspace& work, std::size_t experiment, const orbits::ShootingResidual& residual,
                       const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                       std::vector<ResidualRow>& rows);

/// One row per measure of every motion used, at the value of the parameter.
void add_branch_rows(const Workspace& work, const periodic::BranchResidual& residual,
                     const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                     std::vector<ResidualRow>& rows);

/// The computed orbit of every motion of a branch.
void add_branch_states(const periodic::BranchResidual& residual, const estimator::ActiveSet& active,
                       const Eigen::VectorXd& theta, ResultContext& context);

/// The first node of every fitted segment.
void add_first_nodes(const Job& job, std::size_t experiment, const orbits::ShootingResidual& residual,
                     const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                     ResultContext& context);

/// Prediction errors of the fitted segments, then of those only predicted, from one initial state each.
/// @param theta        the estimate, as the estimator's vector.
/// @param with_fitted  false: only the segments not fitted.
/// @param rows         gets the readings of the segments not fitted.
void add_predictions(const identification::IdentificationProblem& problem, std::size_t experiment,
                     const orbits::SeriesResidual& residual, const estimator::Estimate& estimate,
                     const Eigen::VectorXd& theta, bool with_fitted, ResultContext& context,
                     std::vector<ResidualRow>& rows);

}  // namespace orbid::apps
