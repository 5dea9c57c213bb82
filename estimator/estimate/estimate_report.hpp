#pragma once

#include <vector>

#include "estimator/minimisation/minimum.hpp"
#include "estimator/uncertainty/posterior.hpp"

namespace orbid::estimator {

/// A parameter of which only the value is known.
[[nodiscard]] Estimated bare_estimate(const FreeParameter& parameter, double value);

/// Parameters, derived quantities, error parameters, covariances and the message of an estimate.
void report(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
            const Posterior& posterior, const std::vector<DerivedQuantity>& derived, Estimate& estimate);

/// What an estimate has for every block: latent states, their sds and residuals.
void report_blocks(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                   const Posterior& posterior, Estimate& estimate);

/// The result when the minimisation failed: values without uncertainty, no residuals.
void report_failure(const Problem& problem, const State& state, Estimate& estimate);

}  // namespace orbid::estimator
