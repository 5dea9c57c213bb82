#include "apps/estimate_stage.hpp"

#include <algorithm>
#include <memory>

#include <fmt/format.h>

#include "apps/cycle_file.hpp"
#include "apps/cycle_start.hpp"
#include "apps/estimate_records.hpp"
#include "apps/estimate_setup.hpp"
#include "apps/orbits_stage.hpp"
#include "apps/segment_choice.hpp"
#include "apps/stage_fingerprint.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/data_error.hpp"
#include "orbits/series_residual.hpp"

namespace orbid::apps {

namespace {

/// The residuals of a job, each kept by its own type: results are read back from them.
struct JobResiduals {
    std::unique_ptr<orbits::CycleResidual> cycles;
    std::vector<std::unique_ptr<orbits::SeriesResidual>> series;
    std::vector<std::size_t> experiments;  ///< of `series`: index into Job::data

    [[nodiscard]] std::vector<estimator::Residual*> all() const {
        std::vector<estimator::Residual*> list;
        if (cycles) list.push_back(cycles.get());
        for (const auto& residual : series)
            list.push_back(residual.get());
        return list;
    }
};

orbits::CycleTargetOptions cycle_targets(const CyclesResidualJob& job) {
    orbits::CycleTargetOptions targets;
    targets.periods = job.periods;
    targets.weights = job.covariance ? orbits::CycleWeights::covariance : orbits::CycleWeights::equal;
    for (const ErrorJob& error : job.errors)
        targets.errors.push_back(error.scale);
    return targets;
}

orbits::InitialStateRule initial_rule(const InitialValueJob& job) {
    orbits::InitialStateRule rule;
    using Kind = orbits::InitialStateRule::Kind;
    if (!job.estimate) {
        rule.kind = Kind::fixed;
        rule.value = job.value.value_or(0.0);
    } else if (const auto* normal = std::get_if<estimator::NormalPrior>(&job.prior)) {
        rule.kind = Kind::normal;
        rule.value = normal->mean;
        rule.sd = normal->sd;
        rule.start = job.value;
    } else {
        rule.start = job.value;
    }
    return rule;
}

std::unique_ptr<orbits::SeriesResidual> series_residual(const Job& job, std::size_t experiment,
                                                        const EstimateSetup& setup, const orbits::Series& series) {
    const DataJob& data = job.data[experiment];
    orbits::SeriesResidualOptions options;
    options.name = job.estimate->series->data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(job.model.system->coordinates()[static_cast<std::size_t>(coordinate)].name);
        for (const ErrorJob& error : job.estimate->series->errors) {
            if (error.coordinate == coordinate) options.errors.push_back(error.scale);
        }
    }
    options.segments = fitted_segments(series, data);
    for (const InitialValueJob& initial : data.initial_state)
        options.initial.push_back(initial_rule(initial));
    options.start = setup.start();
    try {
        return std::make_unique<orbits::SeriesResidual>(job.model.system, setup.experiments[experiment], series,
                                                        options);
    } catch (const std::invalid_argument& error) {
        throw orbits::DataError(fmt::format("{}: {}", data.name, error.what()));
    }
}

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
    auto found = residual.orbits(theta);
    for (std::size_t b = 0; b < found.size(); ++b)
        show_start(found[b], search.cycles[residual.cycle_of(b)].points);
    work.folder.store("orbits.json", orbits_text(cycle_file_head(work.job, fingerprint), found, names));
}

/// A series with fewer readings than unknowns cannot be used, whatever the estimator does; parameters with a prior may
/// do without readings, and cycles bring more than is counted here.
/// @throws orbits::DataError naming the experiments and both numbers.
void check_enough_readings(const Job& job, const EstimateSetup& setup, const JobResiduals& residuals) {
    if (residuals.cycles || residuals.series.empty()) return;
    std::size_t readings = 0;
    std::size_t initial_values = 0;
    std::string names;
    for (std::size_t i = 0; i < residuals.series.size(); ++i) {
        names += (names.empty() ? "" : ", ") + job.data[residuals.experiments[i]].name;
        for (const estimator::BlockLayout& block : residuals.series[i]->layout()) {
            readings += block.group.size();
            initial_values += static_cast<std::size_t>(block.latents);
        }
    }
    const auto free = std::count_if(setup.parameters.begin(), setup.parameters.end(),
                                    [](const auto& parameter) { return !estimator::is_proper(parameter.prior); });
    const std::size_t unknowns = static_cast<std::size_t>(free) + initial_values;
    if (readings > unknowns) return;
    throw orbits::DataError(
        fmt::format("{}: too short: {} readings for {} free parameters and {} initial values; at least {} are needed",
                    names, readings, free, initial_values, unknowns + 1));
}

}  // namespace

EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data,
                             const orbits::CycleSearch& search) {
    const Job& job = work.job;
    const EstimateSetup setup = estimate_setup(job);
    EstimateOutcome outcome;
    describe_data(work, data, search, outcome.context);

    work.progress.begin("estimate");
    estimator::EstimateOptions options;
    options.variance = job.estimate->variance;
    // A thousandth of a posterior sd is below what anybody can see. Much less is below the rounding of clean data,
    // whose sds reach down to 1e-10 of the value: the minimiser would only grope about there.
    options.step_tolerance = 1e-3;
    options.interrupted = [&] { return work.interruption.asked(); };
    options.progress = [&](int iteration, double objective) {
        work.progress.at(iteration, fmt::format("objective {:.6g}", objective));
    };

    std::vector<estimator::FreeParameter> parameters = setup.parameters;
    JobResiduals residuals;
    const models::ParameterBinding& cycle_binding =
        job.orbits && !job.orbits->file ? setup.experiments[job.orbits->data] : setup.model;
    CycleStart start;
    if (job.estimate->cycles && !search.cycles.empty()) {
        const auto targets = cycle_targets(*job.estimate->cycles);
        start = start_from_cycles(work, parameters, cycle_binding, search.cycles, targets, options);
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = start.theta[static_cast<Eigen::Index>(i)];
        orbits::CycleResidualOptions cycle_options;
        cycle_options.targets = targets;
        residuals.cycles = std::make_unique<orbits::CycleResidual>(
            job.model.system, cycle_binding, search.cycles, job.section_phase, start.theta, start.nodes, cycle_options);
    }
    if (job.estimate->series) {
        for (const std::size_t experiment : job.estimate->series->data) {
            residuals.series.push_back(series_residual(job, experiment, setup, data[experiment].series));
            residuals.experiments.push_back(experiment);
        }
    }
    check_enough_readings(job, setup, residuals);
    const auto all = residuals.all();
    if (all.empty()) {
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
        add_initial_states(job, experiment, *residuals.series[i], estimate.latents[index],
                           has_sds ? estimate.latent_sds[index] : std::vector<Eigen::VectorXd>{}, outcome.context);
        add_predictions(job, experiment, *residuals.series[i], estimate, theta, outcome.context);
    }
    work.folder.store("residuals.csv", residuals_text(rows));
    work.folder.store("result.json", result_text(estimate, outcome.context));
    return outcome;
}

}  // namespace orbid::apps
