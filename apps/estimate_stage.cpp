#include "apps/estimate_stage.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include <fmt/format.h>

#include "apps/atomic_file.hpp"
#include "apps/cycle_start.hpp"
#include "apps/estimate_setup.hpp"
#include "apps/orbits_stage.hpp"
#include "apps/stage_fingerprint.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/data_error.hpp"
#include "orbits/series_residual.hpp"

namespace orbid::apps {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

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

std::vector<std::size_t> segments_with(const orbits::Series& series, const DataJob& data,
                                       const std::vector<std::string>& labels) {
    std::vector<std::size_t> found;
    for (const std::string& label : labels) {
        const auto segment = std::find_if(series.segments.begin(), series.segments.end(),
                                          [&](const orbits::Segment& one) { return one.label == label; });
        if (segment == series.segments.end()) {
            throw orbits::DataError(fmt::format("{}: there is no segment \"{}\"", data.name, label));
        }
        found.push_back(static_cast<std::size_t>(segment - series.segments.begin()));
    }
    return found;
}

std::vector<std::size_t> fitted_segments(const orbits::Series& series, const DataJob& data) {
    if (data.fit) return segments_with(series, data, *data.fit);
    const auto predicted = segments_with(series, data, data.predict);
    std::vector<std::size_t> rest;
    for (std::size_t s = 0; s < series.segments.size(); ++s) {
        if (std::find(predicted.begin(), predicted.end(), s) == predicted.end()) rest.push_back(s);
    }
    return rest;
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

/// Index of a group's scale in the estimate's list, -1 when there is none.
const estimator::EstimatedScale* scale_of(const estimator::Estimate& estimate, const std::string& group) {
    for (const auto& scale : estimate.scales) {
        if (scale.group == group) return &scale;
    }
    return nullptr;
}

double nearest_prediction(double observed, double e, bool angle) {
    const double predicted = observed - e;
    return angle ? models::wrapped(predicted) : predicted;
}

void add_cycle_rows(const Workspace& work, const orbits::CycleResidual& residual, const orbits::CycleSearch& search,
                    const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                    std::vector<ResidualRow>& rows) {
    const auto coordinates = work.system().coordinates();
    const auto n = static_cast<Eigen::Index>(coordinates.size());
    const std::string experiment = work.job.orbits->file ? std::string() : work.job.data[work.job.orbits->data].name;
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (values[b].e.size() == 0) continue;
        const orbits::Cycle& cycle = search.cycles[residual.cycle_of(b)];
        const auto& layout = residual.layout()[b];
        for (Eigen::Index i = 0; i < values[b].e.size(); ++i) {
            const auto& coordinate = coordinates[static_cast<std::size_t>(i % n)];
            const auto& group = residual.groups()[static_cast<std::size_t>(layout.group[static_cast<std::size_t>(i)])];
            const auto* scale = scale_of(estimate, group.name);
            const double shape = layout.shape.size() > 0 ? std::sqrt(layout.shape(i, i)) : 1.0;
            const double observed = cycle.points(i % n, i / n);
            rows.push_back({experiment, fmt::format("cycle {}", residual.cycle_of(b)), std::string(coordinate.name),
                            work.job.section_phase + 2.0 * std::numbers::pi * static_cast<double>(i / n), observed,
                            nearest_prediction(observed, values[b].e[i], coordinate.angle),
                            scale != nullptr ? scale->value * shape : nan});
        }
    }
}

void add_series_rows(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                     const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                     std::vector<ResidualRow>& rows) {
    const auto& series = residual.series();
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (values[b].e.size() == 0) continue;
        const auto& segment = series.segments[residual.segment(b)];
        const auto& records = residual.records(b);
        for (Eigen::Index i = 0; i < values[b].e.size(); ++i) {
            const auto& record = records[static_cast<std::size_t>(i)];
            if (record.sample < 0) continue;
            const auto& coordinate = job.model.system->coordinates()[static_cast<std::size_t>(record.coordinate)];
            Eigen::Index row = 0;
            while (series.coordinates[static_cast<std::size_t>(row)].name != coordinate.name)
                ++row;
            const auto& group =
                residual.groups()[static_cast<std::size_t>(residual.layout()[b].group[static_cast<std::size_t>(i)])];
            const auto* scale = scale_of(estimate, group.name);
            const double observed = segment.values(row, record.sample);
            rows.push_back({job.data[experiment].name, segment.label, std::string(coordinate.name),
                            segment.times[record.sample], observed, observed - values[b].e[i],
                            scale != nullptr ? scale->value : nan});
        }
    }
}

void add_initial_states(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                        const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                        ResultContext& context) {
    const auto coordinates = job.model.system->coordinates();
    for (std::size_t b = 0; b < latents.size(); ++b) {
        InitialState initial{job.data[experiment].name, residual.series().segments[residual.segment(b)].label, {}};
        const Eigen::VectorXd state = residual.state(latents[b]);
        for (Eigen::Index i = 0; i < state.size(); ++i) {
            const auto& free = residual.free_coordinates();
            const auto at = std::find(free.begin(), free.end(), i);
            const bool known = b < sds.size() && sds[b].size() == static_cast<Eigen::Index>(free.size());
            const double sd = at != free.end() && known ? sds[b][at - free.begin()] : nan;
            const auto& coordinate = coordinates[static_cast<std::size_t>(i)];
            initial.values.push_back(
                {std::string(coordinate.name), std::string(coordinate.unit), state[i], sd, at != free.end()});
        }
        context.initial_states.push_back(std::move(initial));
    }
}

void add_predictions(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                     const estimator::Estimate& estimate, const Eigen::VectorXd& theta, ResultContext& context) {
    const DataJob& data = job.data[experiment];
    std::vector<std::size_t> segments = fitted_segments(residual.series(), data);
    const auto fitted = segments.size();
    const auto predicted = segments_with(residual.series(), data, data.predict);
    segments.insert(segments.end(), predicted.begin(), predicted.end());
    Eigen::VectorXd scales(static_cast<Eigen::Index>(residual.groups().size()));
    for (Eigen::Index g = 0; g < scales.size(); ++g) {
        const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(g)].name);
        scales[g] = scale != nullptr && scale->value > 0.0 ? scale->value : 1.0;
    }
    const auto predictions = residual.predict(theta, scales, segments);
    for (std::size_t i = 0; i < predictions.size(); ++i) {
        Prediction prediction;
        prediction.experiment = data.name;
        prediction.segment = residual.series().segments[predictions[i].segment].label;
        prediction.normalised_rms = predictions[i].normalised_rms;
        prediction.fitted = i < fitted;
        for (Eigen::Index c = 0; c < predictions[i].rms.size(); ++c) {
            const auto coordinate = static_cast<std::size_t>(data.observe[static_cast<std::size_t>(c)]);
            prediction.rms.emplace_back(job.model.system->coordinates()[coordinate].name, predictions[i].rms[c]);
        }
        context.predictions.push_back(std::move(prediction));
    }
}

/// Stores the orbits that belong to the measured cycles at the estimate.
void store_orbits(const Workspace& work, const orbits::CycleResidual& residual, const models::ParameterBinding& binding,
                  const Eigen::VectorXd& theta, const Fingerprint& fingerprint) {
    std::vector<std::string> names;
    for (const Eigen::Index parameter : binding.parameter) {
        names.emplace_back(work.system().parameters()[static_cast<std::size_t>(parameter)].name);
    }
    write_atomically(work.file("orbits.json"),
                     orbits_text(cycle_file_head(work.job, fingerprint), residual.orbits(theta), names));
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
    const auto all = residuals.all();
    if (all.empty()) {
        outcome.estimate.message = "no cycle was found: there is nothing to estimate from";
        work.progress.end(outcome.estimate.message);
        write_atomically(work.file("result.json"), result_text(outcome.estimate, outcome.context));
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
        if (!job.periodic) store_orbits(work, *residuals.cycles, cycle_binding, theta, outcome.context.fingerprint);
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
    write_atomically(work.file("residuals.csv"), residuals_text(rows));
    write_atomically(work.file("result.json"), result_text(estimate, outcome.context));
    return outcome;
}

}  // namespace orbid::apps
