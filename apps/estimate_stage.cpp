#include "apps/estimate_stage.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "apps/cycle_file.hpp"
#include "apps/cycle_start.hpp"
#include "apps/estimate_records.hpp"
#include "apps/estimate_residuals.hpp"
#include "apps/estimate_setup.hpp"
#include "apps/first_use.hpp"
#include "apps/orbit_file.hpp"
#include "apps/orbits_stage.hpp"
#include "apps/posterior_stage.hpp"
#include "apps/segment_choice.hpp"
#include "apps/stage_fingerprint.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/data_error.hpp"
#include "orbits/series_residual.hpp"

namespace orbid::apps {

namespace {

void describe_data(const Workspace& work, const std::vector<Experiment>& data, const orbits::CycleSearch& search,
                   ResultContext& context) {
    for (const ReferenceJob& reference : work.job.reference)
        context.reference[reference.name] = reference.value;
    for (const Experiment& experiment : data) {
        context.data_points += experiment.series.size();
        context.data_segments += experiment.series.segments.size();
        context.captured.insert(context.captured.end(), experiment.captured.begin(), experiment.captured.end());
    }
    for (const orbits::Cycle& cycle : search.cycles)
        ++context.orbits_found[cycle.period];
    context.orbits_missing = search.missing;
    context.fingerprint =
        stage_fingerprint(work.document, {"/model", "/seed", "/section", "/data", "/orbits", "/estimate"});
}

/// Stores the orbits that belong to the measured cycles at the estimate.
void store_orbits(const Workspace& work, const orbits::CycleResidual& residual, const orbits::CycleSearch& search,
                  const models::ParameterBinding& binding, const Eigen::VectorXd& theta,
                  const Fingerprint& fingerprint) {
    std::vector<std::string> names;
    for (const Eigen::Index parameter : binding.parameter) {
        names.emplace_back(work.system().parameters()[static_cast<std::size_t>(parameter)].name);
    }
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

}  // namespace

EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data,
                             const orbits::CycleSearch& search) {
    const Job& job = work.job;
    EstimateSetup setup = estimate_setup(job, fitted_labels(job, data));
    EstimateOutcome outcome;
    describe_data(work, data, search, outcome.context);

    work.progress.begin("estimate");
    estimator::EstimateOptions options;
    options.variance = job.estimate->variance;
    options.joint_priors = job.estimate->joint_priors;
    // A thousandth of a posterior sd is below what anybody can see. Much less is below the rounding of clean data,
    // whose sds reach down to 1e-10 of the value: the minimiser would only grope about there.
    options.step_tolerance = 1e-3;
    options.interrupted = [&] { return work.interruption.asked(); };
    options.progress = [&](int iteration, double objective) {
        work.progress.at(iteration, fmt::format("objective {:.6g}", objective));
    };

    JobResiduals residuals;
    add_series(job, data, setup, residuals);
    for (const std::string& lost : add_waveform(job, data, setup, setup.start(), residuals.waveform))
        work.progress.say(lost);
    std::vector<estimator::FreeParameter> parameters = setup.parameters;
    const models::ParameterBinding& cycle_binding =
        job.orbits && !job.orbits->file ? setup.experiments[job.orbits->data] : setup.model;
    if (const auto flow = first_flow(job, data, search, setup, residuals, cycle_binding)) {
        work.progress.log(compare_derivatives(*flow));
    }
    CycleStart start;
    if (job.estimate->cycles && !search.cycles.empty()) {
        const auto targets = cycle_targets(*job.estimate->cycles);
        CycleStartOptions start_options;
        start_options.estimate = options;
        start_options.log = [&](const std::string& line) { work.progress.log(line); };
        start = start_from_cycles({job.model.system, cycle_binding, search.cycles, job.section_phase, targets},
                                  parameters, start_options);
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = start.theta[static_cast<Eigen::Index>(i)];
        orbits::CycleResidualOptions cycle_options;
        cycle_options.targets = targets;
        residuals.cycles = std::make_unique<orbits::CycleResidual>(
            job.model.system, cycle_binding, search.cycles, job.section_phase, start.theta, start.nodes, cycle_options);
    }
    check_enough_readings(job, setup, residuals);
    if (residuals.all().empty()) {
        if (work.interruption.asked()) {
            outcome.estimate.status = estimator::EstimateStatus::interrupted;
            outcome.estimate.message = "interrupted before the estimate";
        } else {
            outcome.estimate.message = "no cycle was found: there is nothing to estimate from";
        }
        work.progress.end(outcome.estimate.message);
        work.folder.store("result.json", result_text(outcome.estimate, outcome.context));
        return outcome;
    }

    PosteriorResults& posterior = outcome.context.posterior;
    for (const auto& parameter : parameters)
        posterior.parameters.push_back(parameter.name);
    if (job.estimate->multi_start.starts > 1) {
        search_starts(work, residuals, setup.derived, options, parameters, posterior);
        if (residuals.cycles) {
            // Its solutions are those around the first start.
            orbits::CycleResidualOptions cycle_options;
            cycle_options.targets = cycle_targets(*job.estimate->cycles);
            Eigen::VectorXd best(static_cast<Eigen::Index>(parameters.size()));
            for (std::size_t i = 0; i < parameters.size(); ++i)
                best[static_cast<Eigen::Index>(i)] = parameters[i].start;
            residuals.cycles = std::make_unique<orbits::CycleResidual>(
                job.model.system, cycle_binding, search.cycles, job.section_phase, best, start.nodes, cycle_options);
        }
        if (residuals.waveform.residual) {
            Eigen::VectorXd best(static_cast<Eigen::Index>(parameters.size()));
            for (std::size_t i = 0; i < parameters.size(); ++i)
                best[static_cast<Eigen::Index>(i)] = parameters[i].start;
            for (const std::string& lost : add_waveform(job, data, setup, best, residuals.waveform))
                work.progress.say(lost);
        }
        work.progress.begin("estimate");
    }
    const auto all = residuals.all();
    estimator::Estimate& estimate = outcome.estimate;
    estimate = estimator::estimate(parameters, all, setup.derived, options);
    estimate.iterations += start.iterations;
    estimate.evaluations += start.evaluations;
    // The user's start is the job's, not that of the last stage.
    for (std::size_t i = 0; i < setup.parameters.size() && i < estimate.parameters.size(); ++i) {
        estimate.parameters[i].start = setup.parameters[i].start;
    }
    const Eigen::VectorXd job_start = setup.start();
    for (std::size_t i = 0; i < setup.derived.size() && i < estimate.derived.size(); ++i) {
        estimate.derived[i].start = setup.derived[i].value(job_start);
    }
    work.progress.end(fmt::format("{} after {} iterations", estimator::name(estimate.status), estimate.iterations));

    Eigen::VectorXd theta(static_cast<Eigen::Index>(estimate.parameters.size()));
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        theta[i] = estimate.parameters[static_cast<std::size_t>(i)].value;
    std::vector<ResidualRow> rows;
    const bool evaluated = estimate.residuals.size() == all.size() && estimate.latents.size() == all.size();
    if (residuals.cycles && evaluated) {
        add_cycle_rows(work, *residuals.cycles, search, estimate, estimate.residuals.front(), rows);
        if (!job.periodic)
            store_orbits(work, *residuals.cycles, search, cycle_binding, theta, outcome.context.fingerprint);
    }
    for (std::size_t i = 0; evaluated && i < residuals.series.size(); ++i) {
        const std::size_t index = i + (residuals.cycles ? 1 : 0);
        const std::size_t experiment = residuals.experiments[i];
        add_series_rows(job, experiment, *residuals.series[i], estimate, estimate.residuals[index], rows);
        const bool has_sds = index < estimate.latent_sds.size();
        add_initial_states(job, experiment, *residuals.series[i], estimate, setup.initial[experiment],
                           estimate.latents[index],
                           has_sds ? estimate.latent_sds[index] : std::vector<Eigen::VectorXd>{}, outcome.context);
        add_predictions(job, experiment, *residuals.series[i], estimate, theta, outcome.context);
    }
    if (residuals.waveform.residual && evaluated) {
        add_waveform_rows(job, residuals.waveform, estimate, estimate.residuals.back(), rows);
        const bool has_sds = estimate.latent_sds.size() == all.size();
        add_steady_states(job, residuals.waveform, theta, estimate.latents.back(),
                          has_sds ? estimate.latent_sds.back() : std::vector<Eigen::VectorXd>{}, outcome.context);
        for (const auto& plot : waveform_plots(job, residuals.waveform, theta, estimate.latents.back()))
            work.folder.store(plot.first, plot.second);
    }
    if (evaluated) {
        posterior.diagnostics = diagnose_residuals(all, estimate);
        outcome.context.evidence = evidence_of(job, parameters, all, options, estimate);
    } else {
        outcome.context.evidence.reason = "there is no estimate";
    }
    work.folder.store("residuals.csv", residuals_text(rows));
    // Stored before what may take long, and again with it.
    work.folder.store("result.json", result_text(estimate, outcome.context));
    explore_posterior(work, parameters, all, setup.derived, options, estimate, posterior);
    if (work.interruption.asked() && estimate.status != estimator::EstimateStatus::interrupted) {
        estimate.status = estimator::EstimateStatus::interrupted;
        estimate.message = "interrupted after the estimate, which is complete";
    }
    work.folder.store("result.json", result_text(estimate, outcome.context));
    return outcome;
}

}  // namespace orbid::apps
