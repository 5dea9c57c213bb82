#pragma once

#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// Estimates from several starts, telling the best so far, and moves `parameters` to the best result.
void search_starts(StageInput& input, const ProblemResiduals& residuals,
                   std::vector<estimator::FreeParameter>& parameters);

/// The search for a start of series with nodes, see search_series_start(), told to the observer.
[[nodiscard]] SeriesStart searched_series(StageInput& input, const std::vector<estimator::FreeParameter>& parameters);

/// The estimate of a stage, with links mended that ended on wrong branches. After a search for a start that found
/// nothing it ends by itself, as `iteration_limit`, where more steps would cost too much (SeriesStart::affordable).
[[nodiscard]] estimator::Estimate affordable_estimate(const StageInput& input, const SeriesStart& start,
                                                      const std::vector<estimator::FreeParameter>& parameters,
                                                      const ProblemResiduals& residuals,
                                                      estimator::EstimateOptions options);

/// The same less the bias that the folds of noisy sections give it.
[[nodiscard]] estimator::Estimate less_its_bias(const StageInput& input,
                                                const std::vector<estimator::FreeParameter>& parameters,
                                                const ProblemResiduals& residuals,
                                                const estimator::EstimateOptions& options,
                                                estimator::Estimate estimate);

}  // namespace orbid::identification
