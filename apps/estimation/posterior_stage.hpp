#pragma once

#include <vector>

#include "apps/estimation/estimate_residuals.hpp"
#include "apps/results/checkpoint.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::apps {

/// Estimates from several starts if the job requests them, and moves `parameters` to the best result.
void search_starts(const Workspace& work, const JobResiduals& residuals,
                   const std::vector<estimator::DerivedQuantity>& derived, const estimator::EstimateOptions& options,
                   std::vector<estimator::FreeParameter>& parameters, PosteriorResults& results);

/// Profiles, marginals and draws requested by the job, at the estimate of the same parameters and residuals.
/// `results.refused` names what cannot be computed.
void explore_posterior(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                       const std::vector<estimator::Residual*>& residuals,
                       const std::vector<estimator::DerivedQuantity>& derived,
                       const estimator::EstimateOptions& options, const estimator::Estimate& estimate,
                       Checkpoint& checkpoint, PosteriorResults& results);

/// Residuals of every group whose distribution can be examined.
[[nodiscard]] std::vector<GroupDiagnostic> diagnose_residuals(const std::vector<estimator::Residual*>& residuals,
                                                              const estimator::Estimate& estimate);

/// ln p(y) by Laplace's integral: only when every unknown, initial values included, has a proper prior.
[[nodiscard]] LogEvidence evidence_of(const Job& job, const std::vector<estimator::FreeParameter>& parameters,
                                      const std::vector<estimator::Residual*>& residuals,
                                      const estimator::EstimateOptions& options, const estimator::Estimate& estimate);

}  // namespace orbid::apps
