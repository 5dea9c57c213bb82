#pragma once

#include "apps/estimation/estimate_strategy.hpp"
#include "apps/results/strategy_results.hpp"

namespace orbid::apps {

/// Fits the alternatives that the job names to what its estimate was made from, and compares them with it: Bayes
/// factors by Laplace's integral where every prior in which they differ is proper, held-out densities, defects.
///
/// Both models are fitted to the same records with the same matching: cycles that one of them loses count for neither,
/// and exact matching is loosened to the error of the readings. (Where it is tight, a wrong model is held to
/// trajectories that do not exist, and its fit does not converge.)
///
/// @param stage  whose residuals they are compared on, that of `run`.
[[nodiscard]] CriticismResult criticise(const StageInput& input, const StageJob& stage, const StageRun& run);

}  // namespace orbid::apps
