#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// The outcome of the stages of a strategy.
struct StrategyRun {
    /// The last stage that succeeded, or if none did the last one with numbers; empty: none has run.
    std::optional<StageRun> best;
    std::vector<StageResult> stages;                                     ///< in their order
    estimator::EstimateStatus last = estimator::EstimateStatus::failed;  ///< of the last stage that was not skipped
    int iterations = 0;                                                  ///< of all stages
    int evaluations = 0;
    bool unfinished = false;  ///< an interruption left stages out
};

/// Runs stages in order, each from the best before it; none begins after an interruption.
/// @param stored  called after every stage with the results so far.
[[nodiscard]] StrategyRun run_strategy(StageInput& input, const std::vector<Stage>& stages,
                                       const std::vector<estimator::FreeParameter>& parameters,
                                       const std::function<void(const StrategyRun&)>& stored);

/// The estimate of a strategy: that of its best stage, with the status of the last one. A stage that fails after
/// another succeeded loses nothing, but is reported.
[[nodiscard]] estimator::Estimate strategy_estimate(const StrategyRun& strategy, bool interrupted);

}  // namespace orbid::identification
