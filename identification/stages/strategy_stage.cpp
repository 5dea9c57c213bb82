#include "identification/stages/strategy_stage.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "identification/stages/exact_sections.hpp"
#include "identification/stages/harvest_stage.hpp"
#include "identification/stages/series_doubt.hpp"
#include "identification/stages/several_starts.hpp"
#include "identification/stages/stage_value.hpp"
#include "identification/starts/cycle_start.hpp"
#include "identification/starts/prediction_start.hpp"
#include "identification/starts/series_start.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

using estimator::EstimateStatus;
using Parameters = std::vector<estimator::FreeParameter>;

/// A stage that could not run: the parameters stay where they are.
StageRun skipped(const Stage& stage, const Parameters& parameters, std::string reason) {
    StageRun run;
    run.parameters = parameters;
    run.result.stage = stage.name();
    run.result.message = std::move(reason);
    return run;
}

void begin_at(const Eigen::VectorXd& theta, Parameters& parameters) {
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = theta[static_cast<Eigen::Index>(i)];
}

/// Makes the waveform residual anew, with its solutions at `start`.
void make_waveform(const StageInput& input, const Eigen::VectorXd& start, ProblemResiduals& residuals) {
    input.observer.within("steady states at the start");
    for (const std::string& line : add_waveform(input.problem, input.setup, start, residuals.waveform, input.followed))
        input.observer.remark(line);
}

void make_branch(const StageInput& input, const Eigen::VectorXd& start, ProblemResiduals& residuals) {
    input.observer.within("branch at the start");
    for (const std::string& lost : add_branch(input.problem, input.setup, start, residuals.branch))
        input.observer.remark(lost);
}

/// The residual of the cycles, with its solutions around `start`.
std::unique_ptr<orbits::CycleResidual> cycle_residual(const StageInput& input,
                                                      const orbits::CycleTargetOptions& targets,
                                                      const Eigen::VectorXd& start,
                                                      const std::vector<Eigen::MatrixXd>& nodes) {
    if (input.problem.measured.shares_unknown_errors(input.search.cycles))
        input.observer.remark(
            "cycles: errors that their points and times share are not known: intervals may be several times too small; "
            "a stage of type series from here has intervals that hold");
    orbits::CycleResidualOptions options;
    options.targets = targets;
    return std::make_unique<orbits::CycleResidual>(input.problem.system, input.cycle_binding, input.search.cycles,
                                                   input.problem.measured.place(), start, nodes, options);
}

/// The residuals of a stage; cycles and series with a start of their own move `parameters`.
/// @param known  `memory` holds what was found here before.
ProblemResiduals stage_residuals(StageInput& input, const Stage& stage, Parameters& parameters, StageValue& memory,
                                 bool known) {
    const IdentificationProblem& problem = input.problem;
    CycleStart& start = memory.cycles;
    ProblemResiduals residuals;
    if (stage.uses(ResidualType::series)) {
        for (const auto& series : input.prepared.series)
            residuals.series.push_back(std::make_unique<orbits::SeriesResidual>(*series));
        residuals.experiments = input.prepared.experiments;
        if (problem.series->interval) {
            const bool alone = stage.kind == Stage::Kind::residuals && stage.residuals.size() == 1;
            if (!known && alone && input.nodes.nodes.empty() && needs_search(problem))
                memory.series = searched_series(input, parameters);
            if (memory.series.attempts > 0) begin_at(memory.series.theta, parameters);
            SeriesStart nodes = memory.series.attempts > 0 ? memory.series : input.nodes;
            nodes.theta = starts(parameters);
            input.observer.within("states at the nodes");
            // After a search that found nothing, flows that take more steps than this lead nowhere.
            constexpr models::FlowOptions quick_flow{1e-12, 1e-12, 500};
            add_shooting(problem, input.setup, nodes, residuals,
                         nodes.affordable > 0 ? std::optional(quick_flow) : std::nullopt);
        }
    }
    if (stage.uses(ResidualType::waveform)) {
        if (starts(parameters) == input.setup.start() && input.prepared.waveform.residual) {
            residuals.waveform.residual =
                std::make_unique<periodic::WaveformResidual>(*input.prepared.waveform.residual);
            residuals.waveform.places = input.prepared.waveform.places;
        } else {
            make_waveform(input, starts(parameters), residuals);
        }
    }
    if (stage.uses(ResidualType::branch)) {
        if (starts(parameters) == input.setup.start()) {
            residuals.branch = std::make_unique<periodic::BranchResidual>(*input.prepared.branch);
        } else {
            make_branch(input, starts(parameters), residuals);
        }
    }
    if (stage.uses(ResidualType::cycles) && !input.search.cycles.empty()) {
        const orbits::CycleTargetOptions targets = *input.problem.cycles;
        // A harvest begins where an estimate from cycles has ended.
        if (stage.kind == Stage::Kind::residuals) {
            CycleStartOptions start_options;
            start_options.estimate = input.estimate;
            start_options.log = [&](const std::string& line) { input.observer.detail(line); };
            start_options.watched = [&](const std::string& name, const estimator::StepReport& report) {
                input.observer.step(name, report);
            };
            start_options.reached = [&](const Eigen::VectorXd& theta) {
                if (input.kept) input.observer.reached(theta, std::numeric_limits<double>::quiet_NaN());
            };
            if (!known)
                start = start_from_cycles(
                    {problem.system, input.cycle_binding, input.search.cycles, problem.measured.place(), targets},
                    parameters, start_options);
            begin_at(start.theta, parameters);
        }
        input.observer.within("orbits at the start");
        residuals.cycles = cycle_residual(input, targets, starts(parameters), start.nodes);
    }
    return residuals;
}

/// Tries other starts and takes the residuals to the best end.
/// @param known  `memory` holds what was found here before.
void try_starts(StageInput& input, StageValue& memory, bool known, ProblemResiduals& residuals,
                Parameters& parameters) {
    if (known) {
        input.starts->optima = memory.optima;
        input.starts->runs = memory.runs;
        begin_at(memory.best_start, parameters);
    } else {
        search_starts(input, residuals, parameters);
        memory.optima = input.starts->optima;
        memory.runs = input.starts->runs;
        memory.best_start = starts(parameters);
    }
    // Its solutions are those around the first start.
    if (residuals.cycles)
        residuals.cycles = cycle_residual(input, *input.problem.cycles, starts(parameters), memory.cycles.nodes);
    if (residuals.waveform.residual) make_waveform(input, starts(parameters), residuals);
    if (residuals.branch) make_branch(input, starts(parameters), residuals);
    if (!known) input.observer.begin("estimate", 0.0, {});
}

/// Keeps what a stage has come to, unless it is left half done.
void keep(const StageInput& input, const std::string& name, StageValue& memory) {
    if (input.kept && !name.empty() && !input.observer.stopped() && input.left.empty())
        input.observer.keep(name, memory);
}

/// The estimate, and where it may be had with exact matching, that with its residuals and start.
void estimate_or_match_exactly(const StageInput& input, const estimator::EstimateOptions& options,
                               Parameters& parameters, ProblemResiduals& residuals, StageValue& memory) {
    const bool may = may_match_exactly(input, residuals);
    estimator::EstimateOptions first = options;
    if (may) first.maximum_iterations = std::min(options.maximum_iterations, first_look);
    memory.estimate = affordable_estimate(input, memory.series, parameters, residuals, first);
    if (!may) return;
    if (auto exact = exact_sections(input, parameters, residuals, memory.estimate, options)) {
        memory.series = std::move(exact->start);
        residuals = std::move(exact->residuals);
        memory.estimate = std::move(exact->estimate);
        begin_at(memory.series.theta, parameters);
    } else if (options.interrupted && options.interrupted()) {
        // What it has come to is the best so far, but not the end.
        memory.estimate.status = EstimateStatus::interrupted;
        memory.estimate.message = "interrupted while exact matching was tried";
    } else if (memory.estimate.status == EstimateStatus::iteration_limit &&
               first.maximum_iterations < options.maximum_iterations) {
        memory.estimate = affordable_estimate(input, memory.series, parameters, residuals, options);
    }
}

/// @param known  the stage has run before and left `memory`, which is filled otherwise.
/// @param name   under which that is kept; empty: not at all. The estimate leaves `memory`: all its blocks are large.
StageRun estimate_stage(StageInput& input, const Stage& stage, Parameters parameters, StageValue& memory, bool known,
                        const std::string& name) {
    StageRun run;
    run.result.stage = stage.name();
    estimator::EstimateOptions options = input.estimate;
    if (stage.kind == Stage::Kind::prediction) {
        std::optional<Unstoppable> computing(std::in_place, input.observer);
        input.observer.within(input.options.scan ? "coarse scan of starts" : "intervals to predict");
        PredictionStart start = prediction_start(input.problem, input.options, input.setup, input.cycle_binding,
                                                 parameters, known ? &memory.prediction : nullptr);
        computing.reset();
        run.residuals = std::move(start.residuals);
        memory.prediction = start.theta;
        begin_at(start.theta, parameters);
        options = prediction_options(options);
        if (input.kept && !known) input.observer.reached(start.theta, std::numeric_limits<double>::quiet_NaN());
    } else {
        run.residuals = stage_residuals(input, stage, parameters, memory, known);
    }
    if (run.residuals.all().empty())
        return skipped(stage, parameters, "no cycle was found: there is nothing to estimate from");
    check_enough_readings(input.problem, input.setup, run.residuals);
    // A prediction starts from the readings in every interval; "scan" is its way to other parameters.
    if (input.starts != nullptr && input.options.starts > 1 && stage.kind != Stage::Kind::prediction)
        try_starts(input, memory, known, run.residuals, parameters);
    if (!known) {
        estimate_or_match_exactly(input, options, parameters, run.residuals, memory);
        memory.estimate = less_its_bias(input, parameters, run.residuals, options, std::move(memory.estimate));
        // Before it is told, so that what was told is there.
        keep(input, name, memory);
    }
    run.estimate = std::move(memory.estimate);
    run.estimate.iterations += memory.cycles.iterations + memory.series.iterations;
    run.estimate.evaluations += memory.cycles.evaluations + memory.series.evaluations;
    if (memory.series.several_ends && run.estimate.status == EstimateStatus::converged) {
        const std::string met = group_without_errors(run);
        if (memory.series.doubtful || !met.empty()) {
            run.estimate.status = EstimateStatus::no_progress;
            if (!met.empty()) run.estimate.message += fmt::format("; {} is met exactly, links take up its errors", met);
            run.estimate.message += "; no start explains the readings by their errors, and no two lead to the same end";
        }
    }
    run.result.status = run.estimate.status;
    run.parameters = std::move(parameters);
    return run;
}

void describe(const StageInput& input, StageRun& run) {
    estimator::Estimate& estimate = run.estimate;
    // The user's start is the problem's, not that of the last stage.
    for (std::size_t i = 0; i < input.setup.parameters.size() && i < estimate.parameters.size(); ++i)
        estimate.parameters[i].start = input.setup.parameters[i].start;
    const Eigen::VectorXd first_start = input.setup.start();
    for (std::size_t i = 0; i < input.setup.derived.size() && i < estimate.derived.size(); ++i)
        estimate.derived[i].start = input.setup.derived[i].value(first_start);
    StageResult& result = run.result;
    result.message = estimate.message;
    result.parameters = estimate.parameters;
    result.derived = estimate.derived;
    result.counts = estimate.counts;
    result.objective = estimate.objective;
    result.iterations = estimate.iterations;
    result.evaluations = estimate.evaluations;
}

}  // namespace

estimator::EstimateOptions estimate_options(const IdentificationProblem& problem, const Options& options,
                                            Observer& observer) {
    estimator::EstimateOptions estimate;
    estimate.variance = options.variance;
    estimate.joint_priors = problem.joint_priors;
    estimate.step_tolerance = options.step_tolerance;
    estimate.interrupted = [&observer] { return observer.stopped(); };
    estimate.watched = [&observer](const estimator::StepReport& report) {
        if (report.phase == estimator::StepReport::Phase::minimisation)
            observer.reached(report.theta, report.objective);
        observer.step({}, report);
    };
    return estimate;
}

bool StageRun::usable() const {
    return !estimate.parameters.empty() && estimate.status != EstimateStatus::failed &&
           std::all_of(estimate.parameters.begin(), estimate.parameters.end(),
                       [](const estimator::Estimated& one) { return std::isfinite(one.value); });
}

bool StageRun::is_evaluated() const {
    const std::size_t count = residuals.all().size();
    return estimate.residuals.size() == count && estimate.active.size() == count;
}

bool StageRun::skipped() const {
    return !result.status;
}

const models::ParameterBinding& searched_binding(const IdentificationProblem& problem, const EstimateSetup& setup) {
    return problem.measured.experiment ? setup.experiments[*problem.measured.experiment] : setup.model;
}

StageRun fit_stage(StageInput& input, const Stage& stage, const Parameters& parameters) {
    StageValue unused;
    StageRun run = estimate_stage(input, stage, parameters, unused, false, {});
    if (!run.skipped()) describe(input, run);
    return run;
}

namespace {

/// How a stage has ended, in a few words.
std::string outcome_of(const StageInput& input, const StageRun& run) {
    if (!input.left.empty()) return fmt::format("left after {} iterations", run.estimate.iterations);
    if (run.skipped()) return run.result.message;
    return fmt::format("{} after {} iterations", estimator::name(run.estimate.status), run.estimate.iterations);
}

/// A stage that has finished before: everything but the computing.
StageRun remembered_stage(StageInput& input, const Stage& stage, const Parameters& parameters, StageValue& memory) {
    if (memory.search) {
        input.search = *memory.search;
        input.observer.found(input.search);
    }
    StageRun run = memory.skipped.empty() ? estimate_stage(input, stage, parameters, memory, true, {})
                                          : skipped(stage, parameters, memory.skipped);
    if (!run.skipped()) describe(input, run);
    input.observer.recalled(stage.name(), outcome_of(input, run));
    return run;
}

StageRun computed_stage(StageInput& input, const Stage& stage, const Parameters& parameters, const StageRun* before,
                        StageValue& memory, const std::string& name) {
    if (stage.kind == Stage::Kind::harvest) {
        const std::string cycles = name + " cycles";
        const bool known = input.kept && input.observer.recall(cycles, memory);
        if (known && memory.search) {
            input.search = *memory.search;
            input.observer.found(input.search);
            input.observer.recalled("more cycles", fmt::format("{} cycles", input.search.cycles.size()));
        } else if (!known) {
            memory.skipped =
                before == nullptr ? "no estimate from cycles points anywhere" : harvest_cycles(input, *before);
            if (memory.skipped.empty()) memory.search = input.search;
            keep(input, cycles, memory);
        }
        if (!memory.skipped.empty()) {
            keep(input, name, memory);
            return skipped(stage, parameters, memory.skipped);
        }
    }
    // A single stage is called after the whole, which has begun.
    if (input.options.strategy.size() > 1) input.observer.begin(stage.name(), 0.0, {});
    StageRun run = estimate_stage(input, stage, parameters, memory, false, name);
    if (run.skipped()) {
        memory.skipped = run.result.message;
        keep(input, name, memory);
    } else {
        describe(input, run);
    }
    return run;
}

}  // namespace

StageRun run_stage(StageInput& input, const Stage& stage, const Parameters& parameters, const StageRun* before,
                   const std::string& name) {
    StageValue memory;
    if (input.kept && input.observer.recall(name, memory)) return remembered_stage(input, stage, parameters, memory);
    StageRun run = computed_stage(input, stage, parameters, before, memory, name);
    input.observer.end(outcome_of(input, run));
    return run;
}

}  // namespace orbid::identification
