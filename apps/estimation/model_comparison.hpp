#pragma once

#include "apps/estimation/strategy_stage.hpp"
#include "apps/results/strategy_results.hpp"

namespace orbid::apps {

/// Fits the alternatives named by the job to the data of its estimate and compares them with it: by Bayes factors from
/// Laplace's integral if all priors that differ are proper, by held-out densities and by defects.
///
/// Both models are fitted to the same records with the same matching. Cycles that one of them loses are used for
/// neither. Exact matching is loosened to the error of the readings. (Tight matching holds a wrong model to
/// trajectories that do not exist, and its fit does not converge.)
///
/// @param stage  whose residuals are compared, that of `run`.
[[nodiscard]] CriticismResult criticise(const StageInput& input, const StageJob& stage, const StageRun& run);

}  // namespace orbid::apps
