#pragma once

#include <vector>

#include "apps/job/job.hpp"
#include "apps/results/checkpoint.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::apps {

/// Profiles, marginals and draws requested by the job, at the estimate of the same parameters and residuals.
/// `results.refused` names what cannot be computed.
void explore_posterior(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                       const std::vector<const estimator::Residual*>& residuals,
                       const std::vector<estimator::DerivedQuantity>& derived,
                       const estimator::EstimateOptions& options, const estimator::Estimate& estimate,
                       Checkpoint& checkpoint, PosteriorResults& results);

/// ln p(y) by Laplace's integral: only when every unknown, initial values included, has a proper prior.
[[nodiscard]] LogEvidence evidence_of(const Job& job, const std::vector<estimator::FreeParameter>& parameters,
                                      const std::vector<const estimator::Residual*>& residuals,
                                      const estimator::EstimateOptions& options, const estimator::Estimate& estimate);

}  // namespace orbid::apps
