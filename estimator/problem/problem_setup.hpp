#pragma once

#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// Checks the whole call and converts it to coordinates.
///
/// @throws std::invalid_argument naming value and rule: see estimate().
[[nodiscard]] Problem set_up(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
                             const std::vector<DerivedQuantity>& derived, const EstimateOptions& options);

/// Starts of parameters, latent states and scales.
/// @throws std::invalid_argument when a residual's latent states do not fit its layout.
[[nodiscard]] State initial_state(const Problem& problem);

}  // namespace orbid::estimator
