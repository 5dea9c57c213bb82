#pragma once

#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/estimate_result.hpp"
#include "estimator/interface/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// Verbeek's modified off-line Bayesian estimator: theta, latent states and error scales from residuals (M8)-(M11).
///
/// Throws std::invalid_argument naming value and rule: wrong options, starts outside their bounds, a log scale with a
/// start <= 0, duplicate names.
[[nodiscard]] Estimate estimate(const std::vector<FreeParameter>& parameters,
                                const std::vector<const Residual*>& residuals,
                                const std::vector<DerivedQuantity>& derived = {}, const EstimateOptions& options = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop
