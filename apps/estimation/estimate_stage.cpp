#include "apps/estimation/estimate_stage.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/estimation/derivative_self_check.hpp"
#include "apps/estimation/estimate_records.hpp"
#include "apps/estimation/estimate_residuals.hpp"
#include "apps/estimation/estimate_setup.hpp"
#include "apps/estimation/estimate_strategy.hpp"
#include "apps/estimation/estimated_values.hpp"
#include "apps/estimation/matching_check.hpp"
#include "apps/estimation/model_comparison.hpp"
#include "apps/estimation/posterior_stage.hpp"
#include "apps/results/cycle_file.hpp"
#include "apps/results/orbit_file.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::apps {

namespace {

void count_cycles(const orbits::CycleSearch& search, ResultContext& context) {
    context.orbits_found.clear();
    for (const orbits::Cycle& cycle : search.cycles)
        ++context.orbits_found[cycle.period];
}

void describe_data(const Workspace& work, const std::vector<Experiment>& data, const orbits::CycleSearch& search,
                   ResultContext& context) {
    for (const ReferenceJob& reference : work.job.reference)
        context.reference[reference.name] = reference.value;
    if (work.job.model.equations) context.evaluated = work.job.model.compiled ? "compiled" : "interpreted";
    for (const Experiment& experiment : data) {
        context.data_points += experiment.series.size();
        context.data_segments += experiment.series.segments.size();
        context.captured.insert(context.captured.end(), experiment.captured.begin(), experiment.captured.end());
    }
    count_cycles(search, context);
    context.orbits_missing = search.missing;
    context.fingerprint =
        stage_fingerprint(work.document, {"/model", "/seed", "/section", "/flow", "/data", "/orbits", "/estimate"});
}

/// Stores the orbits that belong to the measured cycles at the estimate.
void store_orbits(const Workspace& work, const orbits::CycleResidual& residual, const orbits::CycleSearch& search,
                  const models::ParameterBinding& binding, const Eigen::VectorXd& theta,
                  const Fingerprint& fingerprint) {
    std::vector<std::string> names;
    for (const Eigen::Index parameter : binding.parameter)
        names.emplace_back(work.job.model.parameter(parameter).name);
    ComputedOrbits orbits;
    const auto found = residual.orbits(theta);
    for (std::size_t b = 0; b < found.size(); ++b) {
        ComputedOrbit& computed = orbits.list.emplace_back();
        computed.orbit = found[b];
        computed.origin = "cycle";
        computed.message = orbit_message(found[b]);
        show_start(computed.orbit, search.cycles[residual.cycle_of(b)].points);
    }
    // The stage "periodic" of the same job has orbits of its own.
    const std::string name = work.job.periodic ? "estimate_orbits.json" : "orbits.json";
    work.folder.store(name, orbits_text(cycle_file_head(work.job, fingerprint), orbits, names));
}

/// The estimate has a value for every record.
bool is_evaluated(const StageRun& run) {
    const std::size_t count = run.residuals.all().size();
    return run.estimate.residuals.size() == count && run.estimate.latents.size() == count;
}

/// Rows of residuals.csv, and what result.json says segment by segment; stores orbits and plots.
std::vector<ResidualRow> describe_records(const StageInput& input, const StageRun& run, ResultContext& context) {
    const Workspace& work = input.work;
    const Job& job = work.job;
    const estimator::Estimate& estimate = run.estimate;
    const JobResiduals& residuals = run.residuals;
    std::vector<ResidualRow> rows;
    if (!is_evaluated(run)) return rows;
    const Eigen::VectorXd theta = estimated_theta(estimate);
    const auto sds = [&](std::size_t index) {
        return index < estimate.latent_sds.size() ? estimate.latent_sds[index] : std::vector<Eigen::VectorXd>{};
    };
    std::size_t index = 0;
    if (residuals.cycles) {
        add_cycle_rows(work, *residuals.cycles, input.search, estimate, estimate.residuals[index++], rows);
        if (!job.periodic)
            store_orbits(work, *residuals.cycles, input.search, input.cycle_binding, theta, context.fingerprint);
    }
    for (std::size_t i = 0; i < residuals.series.size(); ++i, ++index) {
        const std::size_t experiment = residuals.experiments[i];
        add_series_rows(job, experiment, *residuals.series[i], estimate, estimate.residuals[index], rows);
        add_initial_states(job, experiment, *residuals.series[i], estimate, input.setup.initial[experiment],
                           estimate.latents[index], sds(index), context);
        add_predictions(job, experiment, *residuals.series[i], estimate, theta, true, context);
    }
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i, ++index) {
        const std::size_t experiment = residuals.shooting_experiments[i];
        add_shooting_rows(job, experiment, *residuals.shooting[i], estimate, estimate.residuals[index], rows);
        add_first_nodes(job, experiment, *residuals.shooting[i], estimate.latents[index], sds(index), context);
        const bool samples = job.data[experiment].sampling() == orbits::Series::Sampling::samples;
        if (job.data[experiment].predict.empty() || !samples) continue;
        // Segments that took no part: single shooting over each.
        const auto single = single_shooting(job, experiment, input.setup, input.data[experiment]);
        add_predictions(job, experiment, *single, estimate, theta, false, context);
    }
    if (residuals.waveform.residual) {
        add_waveform_rows(job, residuals.waveform, estimate, estimate.residuals[index], rows);
        add_steady_states(job, residuals.waveform, theta, estimate.latents[index], sds(index), context);
        for (const auto& plot : waveform_plots(job, residuals.waveform, theta, estimate.latents[index]))
            work.folder.store(plot.first, plot.second);
    }
    return rows;
}

/// result.json of a run that is left with what its strategy has come to.
std::string interrupted_result(const StrategyRun& run, const ResultContext& context) {
    estimator::Estimate estimate = strategy_estimate(run, true);
    estimate.status = estimator::EstimateStatus::interrupted;
    if (estimate.message.empty()) estimate.message = "interrupted";
    return result_text(estimate, context);
}

/// What is said of the matching of nodes, and of other models.
void criticise_result(const StageInput& input, const StrategyRun& strategy, StrategyResults& results) {
    const Job& job = input.work.job;
    const StageRun& best = *strategy.best;
    const auto chosen =
        std::find_if(strategy.stages.begin(), strategy.stages.end(), [](const StageResult& one) { return one.chosen; });
    if (chosen == strategy.stages.end() || !is_evaluated(best)) return;
    const StageJob& stage = job.estimate->strategy[static_cast<std::size_t>(chosen - strategy.stages.begin())];
    if (!input.checkpoint->recall("matching", results.matching)) {
        results.matching = matching_results(input, best, !input.work.interruption.asked());
        if (!input.work.interruption.asked()) input.checkpoint->keep("matching", results.matching);
    }
    if (!job.estimate->criticism.any() || input.work.interruption.asked()) return;
    if (stage.kind == StageJob::Kind::prediction || !best.succeeded()) {
        input.work.progress.say("other models are not compared: there is no estimate to compare them with");
        return;
    }
    results.criticism = criticise(input, stage, best);
}

estimator::EstimateOptions estimate_options(const Workspace& work) {
    estimator::EstimateOptions options;
    options.variance = work.job.estimate->variance;
    options.joint_priors = work.job.estimate->joint_priors;
    // A thousandth of a posterior sd is below what anybody can see. Much less is below the rounding of clean data,
    // whose sds reach down to 1e-10 of the value: the minimiser would only grope about there.
    options.step_tolerance = 1e-3;
    options.interrupted = [&work] { return work.interruption.asked(); };
    options.progress = [&work](int iteration, double objective) {
        work.progress.at(iteration, fmt::format("objective {:.6g}", objective));
    };
    return options;
}

/// Runs the stages; what they have come to is stored after each, and shown if the run is left.
StrategyRun run_stored_strategy(StageInput& input, EstimateOutcome& outcome) {
    const Workspace& work = input.work;
    const std::vector<StageJob>& stages = work.job.estimate->strategy;
    const bool staged = stages.size() > 1;
    return run_strategy(input, stages, input.setup.parameters, [&, staged](const StrategyRun& run) {
        if (staged) outcome.context.strategy.stages = run.stages;
        work.stop.shows(interrupted_result(run, outcome.context));
        if (!staged) return;
        work.folder.store("result.json",
                          result_text(strategy_estimate(run, work.interruption.asked()), outcome.context));
    });
}

/// What the best stage says beyond its estimate: records, other models, posterior.
void describe_best(const StageInput& input, const StrategyRun& strategy, EstimateOutcome& outcome) {
    const Workspace& work = input.work;
    const StageRun& best = *strategy.best;
    ResultContext& context = outcome.context;
    count_cycles(input.search, context);
    context.evidence.reason = "there is no estimate";
    work.folder.store("residuals.csv", residuals_text(describe_records(input, best, context)));
    const auto all = best.residuals.all();
    if (is_evaluated(best)) {
        context.posterior.diagnostics = diagnose_residuals(all, best.estimate);
        context.evidence = evidence_of(work.job, best.parameters, all, input.options, best.estimate);
    }
    // Stored before what may take long, and again with it.
    work.folder.store("result.json", result_text(outcome.estimate, context));
    criticise_result(input, strategy, context.strategy);
    explore_posterior(work, best.parameters, all, input.setup.derived, input.options, outcome.estimate,
                      *input.checkpoint, context.posterior);
    if (!work.interruption.asked() || outcome.estimate.status == estimator::EstimateStatus::interrupted) return;
    outcome.estimate.status = estimator::EstimateStatus::interrupted;
    outcome.estimate.message = "interrupted after the estimate, which is complete";
}

}  // namespace

EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data, const SearchedSection* section,
                             const orbits::CycleSearch& search) {
    const Job& job = work.job;
    EstimateSetup setup = estimate_setup(job, fitted_labels(job, data));
    EstimateOutcome outcome;
    describe_data(work, data, search, outcome.context);

    if (job.estimate->strategy.size() <= 1) work.progress.begin("estimate");
    JobResiduals prepared;
    add_series(job, data, setup, prepared);
    for (const std::string& lost : add_waveform(job, data, setup, setup.start(), prepared.waveform))
        work.progress.say(lost);
    const models::ParameterBinding& cycle_binding = searched_binding(job, setup);
    if (const auto flow = first_flow(job, data, search, setup, prepared, cycle_binding))
        work.progress.log(compare_derivatives(*flow));

    PosteriorResults& posterior = outcome.context.posterior;
    for (const auto& parameter : setup.parameters)
        posterior.parameters.push_back(parameter.name);
    work.stop.shows(interrupted_result({}, outcome.context));
    Checkpoint checkpoint(work.folder, outcome.context.fingerprint);
    StageInput input{work,   data,       section, setup,      cycle_binding, prepared, estimate_options(work),
                     search, &posterior, {},      &checkpoint};
    const StrategyRun strategy = run_stored_strategy(input, outcome);
    outcome.estimate = strategy_estimate(strategy, work.interruption.asked());
    // What is there is described, however long it takes.
    if (work.interruption.asked()) work.stop.finish();
    const bool estimated = strategy.best && !strategy.best->residuals.all().empty();
    if (estimated) {
        describe_best(input, strategy, outcome);
    } else {
        work.progress.end(outcome.estimate.message);
    }
    work.folder.store("result.json", result_text(outcome.estimate, outcome.context));
    if (estimated && !work.interruption.asked()) checkpoint.remove();
    return outcome;
}

}  // namespace orbid::apps
