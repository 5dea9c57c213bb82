#include "identification/stages/strategy_run.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "identification/stages/series_doubt.hpp"

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

/// Stages in their order, each from the best before it.
class StageSequence {
public:
    StageSequence(StageInput& input, const std::vector<estimator::FreeParameter>& parameters)
        : input_(input), current_(parameters) {}

    void run(const Stage& stage) {
        if (stage.if_needed && explained()) return leave_out(stage);
        if (stage.if_needed) begin_again();
        StageRun one = next(stage);
        strategy_.stages.push_back(one.result);
        strategy_.iterations += one.result.iterations;
        strategy_.evaluations += one.result.evaluations;
        if (!one.skipped()) strategy_.last = one.estimate.status;
        // One that did not succeed is better than nothing, and than others that did not.
        const std::string lost = stage.kind == Stage::Kind::prediction ? lost_parameter(one, current_) : "";
        if (!lost.empty()) input_.observer.remark(lost);
        const bool better =
            lost.empty() && (one.succeeded() || !strategy_.best || (!strategy_.best->succeeded() && one.usable()));
        const std::size_t place = strategy_.stages.size() - 1;
        const bool may_be_doubted = stage.is_series() && !stage.if_needed;
        if (may_be_doubted) series_ = place;
        if (may_be_doubted && better) earlier_ = {std::move(strategy_.best), best_, current_, input_.followed};
        if (better)
            take(std::move(one), place);
        else if (may_be_doubted)
            doubted_ = std::move(one);
    }

    [[nodiscard]] StrategyRun& strategy() { return strategy_; }

    /// The best of all, now that no stage follows.
    void finish() {
        if (!doubted_ || !doubted_->succeeded()) return;
        const bool nothing =
            !strategy_.best || !strategy_.best->succeeded() || !strategy_.best->residuals.prediction.empty();
        if (nothing ||
            (is_same_series(*strategy_.best) && doubted_->estimate.objective < strategy_.best->estimate.objective))
            take(std::move(*doubted_), *series_);
    }

private:
    /// Whether the series before is explained; asked once.
    [[nodiscard]] bool explained() {
        if (explained_) return *explained_;
        const std::string doubt = best_ == series_ && strategy_.best
                                      ? series_doubt(*input_.problem.system, *strategy_.best)
                                      : "it has not converged";
        explained_ = doubt.empty();
        input_.observer.remark(doubt.empty() ? "the series is explained: no other stage is needed"
                                             : fmt::format("the series alone is not enough: {}", doubt));
        return *explained_;
    }

    void leave_out(const Stage& stage) {
        StageResult& result = strategy_.stages.emplace_back();
        result.stage = stage.name();
        result.message = "not needed: the series before it is explained";
        result.needless = true;
    }

    /// To where the series began. Its minimum may be a false one.
    void begin_again() {
        if (begun_again_) return;
        begun_again_ = true;
        moved_ = false;
        if (best_ != series_ || !strategy_.best) return;
        doubted_ = std::move(strategy_.best);
        strategy_.best = std::move(earlier_.best);
        best_ = earlier_.place;
        current_ = earlier_.current;
        input_.followed = earlier_.followed;
        choose();
    }

    [[nodiscard]] StageRun next(const Stage& stage) {
        if (stage.uses(ResidualType::cycles) && input_.find_cycles) {
            input_.find_cycles();
            input_.find_cycles = {};
        }
        // Without another start it would come to the same.
        if (stage.if_needed && stage.is_series() && !moved_ && doubted_) {
            StageRun again = std::move(*doubted_);
            doubted_.reset();
            again.result.iterations = again.result.evaluations = 0;
            return again;
        }
        // Kept apart from the same stage over whole segments, which may have run before.
        const auto& series = input_.problem.series;
        const bool divided = series && series->unless_errors_grow && series->interval;
        return run_stage(input_, stage, current_, strategy_.best ? &*strategy_.best : nullptr,
                         fmt::format("stage {}{}", strategy_.stages.size(), divided ? " with nodes" : ""));
    }

    void take(StageRun one, std::size_t place) {
        strategy_.best = std::move(one);
        best_ = place;
        moved_ = true;
        choose();
        input_.followed = followed_states(*strategy_.best);
        for (std::size_t i = 0; strategy_.best->usable() && i < current_.size(); ++i)
            current_[i].start = strategy_.best->estimate.parameters[i].value;
    }

    /// Marks the stage of the best run.
    void choose() {
        for (StageResult& one : strategy_.stages)
            one.chosen = false;
        if (best_) strategy_.stages[*best_].chosen = strategy_.best->usable();
    }

    /// A minimum over the same intervals as the one that was doubted.
    [[nodiscard]] bool is_same_series(const StageRun& run) const {
        const auto& one = run.residuals.shooting;
        const auto& other = doubted_->residuals.shooting;
        return run.result.stage == doubted_->result.stage &&
               std::equal(one.begin(), one.end(), other.begin(), other.end(),
                          [](const auto& a, const auto& b) { return a->interval() == b->interval(); });
    }

    /// What a series with nodes began from.
    struct Earlier {
        std::optional<StageRun> best;
        std::optional<std::size_t> place;
        std::vector<estimator::FreeParameter> current;
        std::vector<FollowedStates> followed;
    };

    StageInput& input_;
    std::vector<estimator::FreeParameter> current_;
    StrategyRun strategy_;
    std::optional<std::size_t> best_, series_;  ///< places of the best stage, and of the series that may be doubted
    Earlier earlier_;
    std::optional<StageRun> doubted_;  ///< the series, where it is not the best
    std::optional<bool> explained_;
    bool begun_again_ = false, moved_ = false;  ///< since then there is another best
};

}  // namespace

StrategyRun run_strategy(StageInput& input, const std::vector<Stage>& stages,
                         const std::vector<estimator::FreeParameter>& parameters,
                         const std::function<void(const StrategyRun&)>& stored) {
    StageSequence sequence(input, parameters);
    for (const Stage& stage : stages) {
        sequence.strategy().unfinished = input.observer.stopped();
        if (sequence.strategy().unfinished) break;
        sequence.run(stage);
        stored(sequence.strategy());
    }
    sequence.finish();
    return std::move(sequence.strategy());
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
        if (!stage->needless)
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
