#pragma once

#include "identification/problem/identification_result.hpp"
#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// Fits the alternatives of the options to the data of its estimate and compares them with it: by Bayes factors from
/// Laplace's integral if all priors that differ are proper, by held-out densities and by defects.
///
/// Both models are fitted to the same records with the same matching. Cycles that one of them loses are used for
/// neither. Exact matching is loosened to the error of the readings. (Tight matching holds a wrong model to
/// trajectories that do not exist, and its fit does not converge.)
///
/// @param stage  whose residuals are compared, that of `run`.
[[nodiscard]] ComparisonResult criticise(const StageInput& input, const Stage& stage, const StageRun& run);

}  // namespace orbid::identification
