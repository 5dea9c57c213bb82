#include "identification/strategy/identify.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "identification/comparison/matching_check.hpp"
#include "identification/comparison/model_comparison.hpp"
#include "identification/stages/strategy_run.hpp"
#include "identification/starts/derivative_self_check.hpp"
#include "identification/starts/error_growth.hpp"
#include "identification/structure/structural_check.hpp"

namespace orbid::identification {

namespace {

/// What is said of the matching of nodes, and of other models.
void criticise_result(const StageInput& input, const StageRun& best, IdentificationResult& result) {
    const auto chosen =
        std::find_if(result.stages.begin(), result.stages.end(), [](const StageResult& one) { return one.chosen; });
    if (chosen == result.stages.end() || !best.is_evaluated()) return;
    const Stage& stage = input.options.strategy[static_cast<std::size_t>(chosen - result.stages.begin())];
    if (!input.observer.recall("matching", result.matching)) {
        input.observer.within("matching of nodes");
        result.matching = matching_results(input, best, !input.observer.stopped());
        input.observer.within({});
        if (!input.observer.stopped()) input.observer.keep("matching", result.matching);
    }
    if (!input.options.comparison.any() || input.observer.stopped()) return;
    if (stage.kind == Stage::Kind::prediction || !best.succeeded()) {
        input.observer.remark("other models are not compared: there is no estimate to compare them with");
        return;
    }
    result.comparison = criticise(input, stage, best);
}

/// What the readings can determine is told, and what they cannot is held.
StructuralReport examined_structure(const IdentificationProblem& problem, EstimateSetup& setup, Observer& observer) {
    observer.within("what the readings can determine");
    StructuralReport report = structural_report(problem, setup);
    hold(report, setup.parameters);
    for (const std::string& line : remarks(report))
        observer.remark(line);
    if (!report.reason.empty()) observer.detail("what the readings can determine was not examined: " + report.reason);
    return report;
}

void find_cycles(MeasuredCycles& measured, StageInput& input) {
    measured.find(measured);
    input.search = measured.search;
}

void drop_blocks(estimator::Estimate& estimate) {
    estimate.active = {};
    estimate.latents = {};
    estimate.latent_sds = {};
    estimate.residuals = {};
}

void take_blocks(const estimator::Estimate& from, estimator::Estimate& estimate) {
    estimate.active = from.active;
    estimate.latents = from.latents;
    estimate.latent_sds = from.latent_sds;
    estimate.residuals = from.residuals;
}

void add_held(const StructuralReport& structure, std::string& message) {
    for (const UndeterminedDirection& direction : structure.directions)
        message +=
            fmt::format("{}{} was held at its start: {}", message.empty() ? "" : "; ", direction.held, direction.text);
}

}  // namespace

IdentificationResult identify(const IdentificationProblem& asked, const Options& given, Observer& observer) {
    validate(given);
    IdentificationProblem problem = completed(asked);
    const std::string divided = divide_where_errors_grow(problem);
    Options options = given;
    if (options.strategy.empty()) options.strategy = automatic_strategy(problem);
    check_strategy(problem, options.strategy);
    EstimateSetup setup = estimate_setup(problem, fitted_labels(problem));
    if (options.strategy.size() <= 1) observer.begin("estimate", 0.0, {});
    ProblemResiduals prepared;
    observer.within("first solutions");
    if (!divided.empty()) observer.remark(divided);
    add_series(problem, setup, prepared);
    // A later stage of waveforms begins where the one before it ends.
    if (options.strategy.front().uses(ResidualType::waveform))
        for (const std::string& line : add_waveform(problem, setup, setup.start(), prepared.waveform))
            observer.remark(line);
    for (const std::string& lost : add_branch(problem, setup, setup.start(), prepared.branch))
        observer.remark(lost);
    const models::ParameterBinding& cycle_binding = searched_binding(problem, setup);
    if (const auto flow = first_flow(problem, setup, prepared, cycle_binding, options.seed))
        observer.detail(compare_derivatives(*flow));
    IdentificationResult result;
    result.structure = examined_structure(problem, setup, observer);
    observer.within({});

    StartResults starts;
    StageInput input{problem,
                     options,
                     observer,
                     setup,
                     cycle_binding,
                     prepared,
                     estimate_options(problem, options, observer),
                     problem.measured.search,
                     &starts,
                     {},
                     true};
    input.signs = result.structure.signs;
    if (problem.measured.find) input.find_cycles = [&] { find_cycles(problem.measured, input); };
    const auto take = [&](const StrategyRun& run) {
        result.stages = run.stages;
        result.estimate = strategy_estimate(run, observer.stopped());
        add_held(result.structure, result.estimate.message);
        result.optima = starts.optima;
        result.runs = starts.runs;
        result.cycles = input.search.cycles;
    };
    StrategyRun strategy = run_strategy(input, options.strategy, setup.parameters, [&](const StrategyRun& run) {
        take(run);
        observer.stage_ended(result);
    });
    take(strategy);
    if (!strategy.best || strategy.best->residuals.all().empty()) {
        observer.end(result.estimate.message);
        return result;
    }
    const auto best = std::make_shared<const StageRun>(std::move(*strategy.best));
    result.best = best;
    observer.estimated(result);
    // What an estimate has for every block is not held twice beside another estimate.
    drop_blocks(result.estimate);
    criticise_result(input, *best, result);
    take_blocks(best->estimate, result.estimate);
    return result;
}

IdentificationResult identify(const IdentificationProblem& problem, const Options& options) {
    Observer observer;
    return identify(problem, options, observer);
}

}  // namespace orbid::identification
