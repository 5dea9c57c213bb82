#include "apps/estimation/strategy_stage.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/estimation/cycle_start.hpp"
#include "apps/estimation/estimate_shooting.hpp"
#include "apps/estimation/estimated_values.hpp"
#include "apps/estimation/harvest_stage.hpp"
#include "apps/estimation/posterior_stage.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using estimator::EstimateStatus;
constexpr const char* skipped_status = "skipped";
using Parameters = std::vector<estimator::FreeParameter>;

/// A stage that could not run: the parameters stay where they are.
StageRun skipped(const StageJob& stage, const Parameters& parameters, std::string reason) {
    StageRun run;
    run.parameters = parameters;
    run.result.stage = stage.name();
    run.result.status = skipped_status;
    run.result.message = std::move(reason);
    return run;
}

void begin_at(const Eigen::VectorXd& theta, Parameters& parameters) {
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = theta[static_cast<Eigen::Index>(i)];
}

/// Makes the waveform residual anew, with its solutions at `start`.
void make_waveform(const StageInput& input, const Eigen::VectorXd& start, JobResiduals& residuals) {
    for (const std::string& lost : add_waveform(input.work.job, input.data, input.setup, start, residuals.waveform))
        input.work.progress.say(lost);
}

/// The residual of the cycles, with its solutions around `start`.
std::unique_ptr<orbits::CycleResidual> cycle_residual(const StageInput& input,
                                                      const orbits::CycleTargetOptions& targets,
                                                      const Eigen::VectorXd& start,
                                                      const std::vector<Eigen::MatrixXd>& nodes) {
    orbits::CycleResidualOptions options;
    options.targets = targets;
    return std::make_unique<orbits::CycleResidual>(input.work.job.model.system, input.cycle_binding,
                                                   input.search.cycles, input.work.job.section_phase, start, nodes,
                                                   options);
}

/// The residuals of a stage; cycles with a start of their own move `parameters`.
/// @param known  `start` holds what was found here before.
JobResiduals stage_residuals(StageInput& input, const StageJob& stage, Parameters& parameters, CycleStart& start,
                             bool known) {
    const Job& job = input.work.job;
    JobResiduals residuals;
    if (stage.uses(ResidualType::series)) {
        for (const auto& series : input.prepared.series)
            residuals.series.push_back(std::make_unique<orbits::SeriesResidual>(*series));
        residuals.experiments = input.prepared.experiments;
        if (job.estimate->series->interval)
            add_shooting(job, input.data, input.setup, starts(parameters), input.nodes, residuals);
    }
    if (stage.uses(ResidualType::waveform)) {
        if (starts(parameters) == input.setup.start()) {
            residuals.waveform.residual =
                std::make_unique<periodic::WaveformResidual>(*input.prepared.waveform.residual);
            residuals.waveform.places = input.prepared.waveform.places;
        } else {
            make_waveform(input, starts(parameters), residuals);
        }
    }
    if (stage.uses(ResidualType::cycles) && !input.search.cycles.empty()) {
        const orbits::CycleTargetOptions targets = cycle_targets(job);
        // A harvest begins where an estimate from cycles has ended.
        if (stage.kind == StageJob::Kind::residuals) {
            CycleStartOptions start_options;
            start_options.estimate = input.options;
            start_options.log = [&](const std::string& line) { input.work.progress.log(line); };
            if (!known)
                start = start_from_cycles(
                    {job.model.system, input.cycle_binding, input.search.cycles, job.section_phase, targets},
                    parameters, start_options);
            begin_at(start.theta, parameters);
        }
        residuals.cycles = cycle_residual(input, targets, starts(parameters), start.nodes);
    }
    return residuals;
}

/// Tries other starts and takes the residuals to the best end.
/// @param known  `memory` holds what was found here before.
void try_starts(StageInput& input, StageCheckpoint& memory, bool known, JobResiduals& residuals,
                Parameters& parameters) {
    if (known) {
        input.starts->optima = memory.optima;
        input.starts->runs = memory.runs;
        begin_at(memory.best_start, parameters);
    } else {
        search_starts(input.work, residuals, input.setup.derived, input.options, parameters, *input.starts);
        memory.optima = input.starts->optima;
        memory.runs = input.starts->runs;
        memory.best_start = starts(parameters);
    }
    // Its solutions are those around the first start.
    if (residuals.cycles)
        residuals.cycles =
            cycle_residual(input, cycle_targets(input.work.job), starts(parameters), memory.cycles.nodes);
    if (residuals.waveform.residual) make_waveform(input, starts(parameters), residuals);
    if (!known) input.work.progress.begin("estimate");
}

/// The minimisation, or what it came to before, with the residuals in the state that it left them in.
estimator::Estimate minimised(const StageInput& input, const Parameters& parameters, const JobResiduals& residuals,
                              const estimator::EstimateOptions& options, StageCheckpoint& memory, bool known) {
    const std::vector<estimator::Residual*> all = residuals.all();
    if (known) {
        for (std::size_t r = 0; r < all.size(); ++r)
            repeat_changes(memory.changes.at(r), *all[r]);
        return memory.estimate;
    }
    std::vector<RecordedResidual> recorded;
    recorded.reserve(all.size());
    std::vector<estimator::Residual*> asked;
    for (estimator::Residual* residual : all)
        asked.push_back(&recorded.emplace_back(*residual));
    memory.estimate = estimator::estimate(parameters, asked, input.setup.derived, options);
    for (const RecordedResidual& residual : recorded)
        memory.changes.push_back(residual.changes());
    return memory.estimate;
}

/// @param known  the stage has run before and left `memory`, which is filled otherwise.
StageRun estimate_stage(StageInput& input, const StageJob& stage, Parameters parameters, StageCheckpoint& memory,
                        bool known) {
    StageRun run;
    run.result.stage = stage.name();
    estimator::EstimateOptions options = input.options;
    if (stage.kind == StageJob::Kind::prediction) {
        std::optional<RunStop::AtOnce> leaving(std::in_place, input.work.stop);
        PredictionStart start = prediction_start(input.work.job, input.data, input.setup, input.cycle_binding,
                                                 parameters, known ? &memory.prediction : nullptr);
        leaving.reset();
        run.residuals = std::move(start.residuals);
        memory.prediction = start.theta;
        begin_at(start.theta, parameters);
        options = prediction_options(options);
    } else {
        run.residuals = stage_residuals(input, stage, parameters, memory.cycles, known);
    }
    if (run.residuals.all().empty())
        return skipped(stage, parameters, "no cycle was found: there is nothing to estimate from");
    check_enough_readings(input.work.job, input.setup, run.residuals);
    if (input.starts != nullptr && input.work.job.estimate->multi_start.starts > 1)
        try_starts(input, memory, known, run.residuals, parameters);
    run.estimate = minimised(input, parameters, run.residuals, options, memory, known);
    run.estimate.iterations += memory.cycles.iterations;
    run.estimate.evaluations += memory.cycles.evaluations;
    run.parameters = std::move(parameters);
    return run;
}

void describe(const StageInput& input, StageRun& run) {
    estimator::Estimate& estimate = run.estimate;
    // The user's start is the job's, not that of the last stage.
    for (std::size_t i = 0; i < input.setup.parameters.size() && i < estimate.parameters.size(); ++i)
        estimate.parameters[i].start = input.setup.parameters[i].start;
    const Eigen::VectorXd job_start = input.setup.start();
    for (std::size_t i = 0; i < input.setup.derived.size() && i < estimate.derived.size(); ++i)
        estimate.derived[i].start = input.setup.derived[i].value(job_start);
    StageResult& result = run.result;
    result.status = estimator::name(estimate.status);
    result.message = estimate.message;
    result.parameters = estimate.parameters;
    result.derived = estimate.derived;
    result.counts = estimate.counts;
    result.objective = estimate.objective;
    result.iterations = estimate.iterations;
    result.evaluations = estimate.evaluations;
}

}  // namespace

bool StageRun::usable() const {
    return !estimate.parameters.empty() && estimate.status != EstimateStatus::failed &&
           std::all_of(estimate.parameters.begin(), estimate.parameters.end(),
                       [](const estimator::Estimated& one) { return std::isfinite(one.value); });
}

bool StageRun::skipped() const {
    return result.status == skipped_status;
}

const models::ParameterBinding& searched_binding(const Job& job, const EstimateSetup& setup) {
    return job.orbits && !job.orbits->file ? setup.experiments[job.orbits->data] : setup.model;
}

StageRun fit_stage(StageInput& input, const StageJob& stage, const Parameters& parameters) {
    StageCheckpoint unused;
    StageRun run = estimate_stage(input, stage, parameters, unused, false);
    if (!run.skipped()) describe(input, run);
    return run;
}

namespace {

/// A stage that has finished before: everything but the computing.
StageRun remembered_stage(StageInput& input, const StageJob& stage, const Parameters& parameters,
                          StageCheckpoint& memory) {
    if (memory.search) {
        input.search = *memory.search;
        store_harvest(input);
    }
    StageRun run = memory.skipped.empty() ? estimate_stage(input, stage, parameters, memory, true)
                                          : skipped(stage, parameters, memory.skipped);
    if (run.skipped()) {
        input.work.progress.reused(stage.name(), run.result.message);
        return run;
    }
    describe(input, run);
    input.work.progress.reused(
        stage.name(), fmt::format("{} after {} iterations, from checkpoint.bin", estimator::name(run.estimate.status),
                                  run.estimate.iterations));
    return run;
}

StageRun computed_stage(StageInput& input, const StageJob& stage, const Parameters& parameters, const StageRun* before,
                        StageCheckpoint& memory, const std::string& name) {
    if (stage.kind == StageJob::Kind::harvest) {
        const std::string cycles = name + " cycles";
        const bool known = input.checkpoint != nullptr && input.checkpoint->recall(cycles, memory);
        if (known && memory.search) {
            input.search = *memory.search;
            store_harvest(input);
            input.work.progress.reused("more cycles", fmt::format("{} cycles", input.search.cycles.size()));
        } else if (!known) {
            memory.skipped =
                before == nullptr ? "no estimate from cycles points anywhere" : harvest_cycles(input, *before);
            if (memory.skipped.empty()) memory.search = input.search;
            if (input.checkpoint != nullptr && !input.work.interruption.asked()) input.checkpoint->keep(cycles, memory);
        }
        if (!memory.skipped.empty()) return skipped(stage, parameters, memory.skipped);
    }
    // A single stage is called after the whole, which has begun.
    if (input.work.job.estimate->strategy.size() > 1) input.work.progress.begin(stage.name());
    StageRun run = estimate_stage(input, stage, parameters, memory, false);
    if (run.skipped()) {
        memory.skipped = run.result.message;
    } else {
        describe(input, run);
    }
    return run;
}

}  // namespace

StageRun run_stage(StageInput& input, const StageJob& stage, const Parameters& parameters, const StageRun* before,
                   const std::string& name) {
    StageCheckpoint memory;
    if (input.checkpoint != nullptr && input.checkpoint->recall(name, memory))
        return remembered_stage(input, stage, parameters, memory);
    StageRun run = computed_stage(input, stage, parameters, before, memory, name);
    // Kept before it is told, so that what was told is there. An interruption leaves a stage half done.
    if (input.checkpoint != nullptr && !input.work.interruption.asked()) input.checkpoint->keep(name, memory);
    if (run.skipped()) {
        input.work.progress.end(run.result.message);
    } else {
        input.work.progress.end(
            fmt::format("{} after {} iterations", estimator::name(run.estimate.status), run.estimate.iterations));
    }
    return run;
}

}  // namespace orbid::apps
