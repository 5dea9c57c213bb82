#include "apps/estimate_strategy.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "apps/cycle_file.hpp"
#include "apps/cycle_start.hpp"
#include "apps/estimate_shooting.hpp"
#include "apps/orbits_stage.hpp"
#include "apps/posterior_stage.hpp"
#include "apps/stage_fingerprint.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/data_error.hpp"
#include "orbits/harvest.hpp"

namespace orbid::apps {

namespace {

using estimator::EstimateStatus;
constexpr const char* skipped_status = "skipped";
using Parameters = std::vector<estimator::FreeParameter>;

Eigen::VectorXd starts(const Parameters& parameters) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = parameters[i].start;
    return theta;
}

/// A stage that could not run: the parameters stay where they are.
StageRun skipped(const StageJob& stage, const Parameters& parameters, std::string reason) {
    StageRun run;
    run.parameters = parameters;
    run.result.stage = stage.name();
    run.result.status = skipped_status;
    run.result.message = std::move(reason);
    return run;
}

/// The residuals of a stage; cycles with a start of their own move `parameters`.
JobResiduals stage_residuals(StageInput& input, const StageJob& stage, Parameters& parameters, CycleStart& start) {
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
            for (const std::string& lost :
                 add_waveform(job, input.data, input.setup, starts(parameters), residuals.waveform))
                input.work.progress.say(lost);
        }
    }
    if (stage.uses(ResidualType::cycles) && !input.search.cycles.empty()) {
        orbits::CycleResidualOptions options;
        options.targets = cycle_targets(job);
        // A harvest begins where an estimate from cycles has ended.
        if (stage.kind == StageJob::Kind::residuals) {
            CycleStartOptions start_options;
            start_options.estimate = input.options;
            start_options.log = [&](const std::string& line) { input.work.progress.log(line); };
            start = start_from_cycles(
                {job.model.system, input.cycle_binding, input.search.cycles, job.section_phase, options.targets},
                parameters, start_options);
            for (std::size_t i = 0; i < parameters.size(); ++i)
                parameters[i].start = start.theta[static_cast<Eigen::Index>(i)];
        }
        residuals.cycles =
            std::make_unique<orbits::CycleResidual>(job.model.system, input.cycle_binding, input.search.cycles,
                                                    job.section_phase, starts(parameters), start.nodes, options);
    }
    return residuals;
}

/// Sds of the model's free parameters, as far as an estimate knows them all.
std::optional<Eigen::MatrixXd> known_covariance(const estimator::Estimate& estimate,
                                                const models::ParameterBinding& binding) {
    const Eigen::MatrixXd& all = estimate.covariance;
    if (all.rows() != static_cast<Eigen::Index>(estimate.parameters.size())) return std::nullopt;
    const Eigen::MatrixXd own = all(binding.estimated, binding.estimated);
    return own.allFinite() ? std::optional(own) : std::nullopt;
}

/// Adds to the cycles what the estimate before points to. What there is to say is said; why nothing was done is
/// returned.
std::string harvest_cycles(StageInput& input, const StageRun& before) {
    const Job& job = input.work.job;
    if (input.section == nullptr) return "cycles were not searched for in a series";
    const auto covariance = known_covariance(before.estimate, input.cycle_binding);
    if (!covariance) return "the estimate before leaves a direction undetermined: it points nowhere";
    orbits::HarvestOptions options;
    options.search = input.section->options;
    // Known from the first search, they need not be estimated again.
    if (options.search.reading_covariance.size() == 0 &&
        input.search.reading_covariance.rows() == input.section->series().dimension())
        options.search.reading_covariance = input.search.reading_covariance;
    options.sensor = job.data[job.orbits->data].sensor;
    options.phase = job.section_phase;
    options.covariance = *covariance;
    options.free = input.cycle_binding.parameter;
    input.work.progress.begin("harvest");
    Eigen::VectorXd theta(static_cast<Eigen::Index>(before.estimate.parameters.size()));
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        theta[i] = before.estimate.parameters[static_cast<std::size_t>(i)].value;
    orbits::Harvest found;
    try {
        found = orbits::harvest(input.section->series(), *job.model.system, input.cycle_binding.values(theta),
                                input.search.cycles, options);
    } catch (const std::invalid_argument& error) {
        input.work.progress.end(error.what());
        return error.what();
    }
    input.work.progress.end(fmt::format("{} new cycles from {} orbits; {} not visited, {} rejected",
                                        found.cycles.size(), found.candidates, found.not_visited, found.rejected));
    for (const std::string& remark : found.remarks)
        input.work.progress.say(remark);
    if (found.cycles.empty()) return "no further cycle was found in the series";
    // Partners are indices into the list: those of new cycles count from their own beginning.
    const std::size_t known = input.search.cycles.size();
    for (orbits::Cycle& cycle : found.cycles) {
        if (cycle.mirror) *cycle.mirror += known;
        input.search.cycles.push_back(std::move(cycle));
    }
    input.work.folder.store(
        "harvested_cycles.json",
        cycles_text({cycle_file_head(job, stage_fingerprint(input.work.document, {"/model", "/seed", "/section",
                                                                                  "/data", "/orbits", "/estimate"})),
                     input.search}));
    return {};
}

/// Tries other starts and takes the residuals to the best end.
void try_starts(StageInput& input, const std::vector<Eigen::MatrixXd>& nodes, JobResiduals& residuals,
                Parameters& parameters) {
    const Job& job = input.work.job;
    search_starts(input.work, residuals, input.setup.derived, input.options, parameters, *input.starts);
    if (residuals.cycles) {
        // Its solutions are those around the first start.
        orbits::CycleResidualOptions options;
        options.targets = cycle_targets(job);
        residuals.cycles =
            std::make_unique<orbits::CycleResidual>(job.model.system, input.cycle_binding, input.search.cycles,
                                                    job.section_phase, starts(parameters), nodes, options);
    }
    if (residuals.waveform.residual) {
        for (const std::string& lost :
             add_waveform(job, input.data, input.setup, starts(parameters), residuals.waveform))
            input.work.progress.say(lost);
    }
    input.work.progress.begin("estimate");
}

StageRun estimate_stage(StageInput& input, const StageJob& stage, Parameters parameters) {
    StageRun run;
    run.result.stage = stage.name();
    estimator::EstimateOptions options = input.options;
    if (stage.kind == StageJob::Kind::prediction) {
        PredictionStart start =
            prediction_start(input.work.job, input.data, input.setup, input.cycle_binding, parameters);
        run.residuals = std::move(start.residuals);
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = start.theta[static_cast<Eigen::Index>(i)];
        options = prediction_options(options);
    }
    CycleStart start;
    if (stage.kind != StageJob::Kind::prediction) run.residuals = stage_residuals(input, stage, parameters, start);
    if (run.residuals.all().empty())
        return skipped(stage, parameters, "no cycle was found: there is nothing to estimate from");
    check_enough_readings(input.work.job, input.setup, run.residuals);
    if (input.starts != nullptr && input.work.job.estimate->multi_start.starts > 1)
        try_starts(input, start.nodes, run.residuals, parameters);
    run.estimate = estimator::estimate(parameters, run.residuals.all(), input.setup.derived, options);
    run.estimate.iterations += start.iterations;
    run.estimate.evaluations += start.evaluations;
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

const models::ParameterBinding& searched_binding(const Job& job, const EstimateSetup& setup) {
    return job.orbits && !job.orbits->file ? setup.experiments[job.orbits->data] : setup.model;
}

StageRun fit_stage(StageInput& input, const StageJob& stage, const Parameters& parameters) {
    StageRun run = estimate_stage(input, stage, parameters);
    if (run.result.status != skipped_status) describe(input, run);
    return run;
}

StageRun run_stage(StageInput& input, const StageJob& stage, const Parameters& parameters, const StageRun* before) {
    if (stage.kind == StageJob::Kind::harvest) {
        const std::string reason =
            before == nullptr ? "no estimate from cycles points anywhere" : harvest_cycles(input, *before);
        if (!reason.empty()) return skipped(stage, parameters, reason);
    }
    // A single stage is called after the whole, which has begun.
    if (input.work.job.estimate->strategy.size() > 1) input.work.progress.begin(stage.name());
    StageRun run = fit_stage(input, stage, parameters);
    if (run.result.status == skipped_status) {
        input.work.progress.end(run.result.message);
        return run;
    }
    input.work.progress.end(
        fmt::format("{} after {} iterations", estimator::name(run.estimate.status), run.estimate.iterations));
    return run;
}

StrategyRun run_strategy(StageInput& input, const std::vector<StageJob>& stages, const Parameters& parameters,
                         const std::function<void(const StrategyRun&)>& stored) {
    StrategyRun strategy;
    Parameters current = parameters;
    for (const StageJob& stage : stages) {
        if (input.work.interruption.asked()) break;
        StageRun run = run_stage(input, stage, current, strategy.best ? &*strategy.best : nullptr);
        strategy.stages.push_back(run.result);
        strategy.iterations += run.result.iterations;
        strategy.evaluations += run.result.evaluations;
        if (run.result.status != skipped_status) strategy.last = run.estimate.status;
        // One that did not succeed is better than nothing, and than others that did not.
        const bool better = run.succeeded() || !strategy.best || (!strategy.best->succeeded() && run.usable());
        if (better) {
            for (StageResult& one : strategy.stages)
                one.chosen = false;
            strategy.stages.back().chosen = run.usable();
            strategy.best = std::move(run);
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
        estimate.status = EstimateStatus::interrupted;
        estimate.message = "interrupted before the estimate";
        return estimate;
    }
    if (strategy.best && strategy.best->result.status == skipped_status)
        estimate.message = strategy.best->result.message;
    if (strategy.stages.size() < 2) return estimate;
    const auto chosen =
        std::find_if(strategy.stages.begin(), strategy.stages.end(), [](const StageResult& one) { return one.chosen; });
    if (chosen == strategy.stages.end()) return estimate;
    std::string later;
    for (auto stage = chosen + 1; stage != strategy.stages.end(); ++stage)
        later +=
            fmt::format("; {} {}{}{}", stage->stage, stage->status, stage->message.empty() ? "" : ": ", stage->message);
    if (strategy.last != strategy.best->estimate.status) estimate.status = strategy.last;
    if (interrupted) estimate.status = EstimateStatus::interrupted;
    if (!later.empty())
        estimate.message = fmt::format("{}{}the estimate is that of the stage {}{}", estimate.message,
                                       estimate.message.empty() ? "" : "; ", chosen->stage, later);
    return estimate;
}

}  // namespace orbid::apps
