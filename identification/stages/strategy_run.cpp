#include "identification/stages/strategy_run.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace orbid::identification {

namespace {

/// A parameter that predictions over one interval have lost, in a sentence; empty when there is none. It happens to
/// intervals that say nothing of a parameter, and on a logarithmic scale nothing brings it back.
std::string lost_parameter(const StageRun& run, const std::vector<estimator::FreeParameter>& starts) {
    constexpr double far = 1e3;  // times its start: no start is meant to be so wrong
    if (!run.usable()) return {};
    for (std::size_t i = 0; i < starts.size(); ++i) {
        const bool log_scale = starts[i].scale == estimator::Scale::log || starts[i].scale == estimator::Scale::log10;
        const double ratio = run.estimate.parameters[i].value / starts[i].start;
        if (!log_scale || (ratio > 1.0 / far && ratio < far)) continue;
        return fmt::format(
            "prediction: its intervals do not tell {}, which went from {:.3g} to {:.3g}: the next stage begins at the "
            "job's start",
            starts[i].name, starts[i].start, run.estimate.parameters[i].value);
    }
    return {};
}

}  // namespace

StrategyRun run_strategy(StageInput& input, const std::vector<Stage>& stages,
                         const std::vector<estimator::FreeParameter>& parameters,
                         const std::function<void(const StrategyRun&)>& stored) {
    StrategyRun strategy;
    std::vector<estimator::FreeParameter> current = parameters;
    for (const Stage& stage : stages) {
        strategy.unfinished = input.observer.stopped();
        if (strategy.unfinished) break;
        StageRun run = run_stage(input, stage, current, strategy.best ? &*strategy.best : nullptr,
                                 fmt::format("stage {}", strategy.stages.size()));
        strategy.stages.push_back(run.result);
        strategy.iterations += run.result.iterations;
        strategy.evaluations += run.result.evaluations;
        if (!run.skipped()) strategy.last = run.estimate.status;
        // One that did not succeed is better than nothing, and than others that did not.
        const std::string lost = stage.kind == Stage::Kind::prediction ? lost_parameter(run, current) : "";
        if (!lost.empty()) input.observer.remark(lost);
        const bool better =
            lost.empty() && (run.succeeded() || !strategy.best || (!strategy.best->succeeded() && run.usable()));
        if (better) {
            for (StageResult& one : strategy.stages)
                one.chosen = false;
            strategy.stages.back().chosen = run.usable();
            strategy.best = std::move(run);
            input.followed = followed_states(*strategy.best);
            for (std::size_t i = 0; strategy.best->usable() && i < current.size(); ++i)
                current[i].start = strategy.best->estimate.parameters[i].value;
        }
        stored(strategy);
    }
    return strategy;
}

estimator::Estimate strategy_estimate(const StrategyRun& strategy, bool interrupted) {
    estimator::Estimate estimate;
    if (strategy.best) estimate = strategy.best->estimate;
    estimate.iterations = strategy.iterations;
    estimate.evaluations = strategy.evaluations;
    if (!strategy.best && interrupted) {
        estimate.status = estimator::EstimateStatus::interrupted;
        estimate.message = "interrupted before the estimate";
        return estimate;
    }
    if (strategy.best && strategy.best->skipped()) estimate.message = strategy.best->result.message;
    if (strategy.unfinished) estimate.status = estimator::EstimateStatus::interrupted;
    if (strategy.stages.size() < 2 && !strategy.unfinished) return estimate;
    const auto chosen =
        std::find_if(strategy.stages.begin(), strategy.stages.end(), [](const StageResult& one) { return one.chosen; });
    if (chosen == strategy.stages.end()) return estimate;
    std::string later;
    for (auto stage = chosen + 1; stage != strategy.stages.end(); ++stage)
        later += fmt::format("; {} {}{}{}", stage->stage, status_name(stage->status),
                             stage->message.empty() ? "" : ": ", stage->message);
    if (strategy.last != strategy.best->estimate.status) estimate.status = strategy.last;
    if (interrupted) estimate.status = estimator::EstimateStatus::interrupted;
    if (!later.empty() || strategy.unfinished)
        estimate.message = fmt::format("{}{}the estimate is that of the stage {}{}", estimate.message,
                                       estimate.message.empty() ? "" : "; ", chosen->stage, later);
    return estimate;
}

}  // namespace orbid::identification
