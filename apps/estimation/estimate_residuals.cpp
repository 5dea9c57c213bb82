#include "apps/estimation/estimate_residuals.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "apps/job/segment_choice.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

orbits::ErrorForm error_form(const ErrorJob& error) {
    return {error.distribution, error.floor, !error.sd_column.empty()};
}

namespace {

orbits::InitialStateRule initial_rule(const InitialValueJob& job, const std::vector<Eigen::Index>& parameters) {
    orbits::InitialStateRule rule;
    using Kind = orbits::InitialStateRule::Kind;
    if (!job.estimate) {
        rule.kind = Kind::fixed;
        rule.value = job.value.value_or(0.0);
    } else if (job.is_parameter()) {
        rule.kind = Kind::parameter;
        rule.parameters = parameters;
        rule.start = job.value;
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

/// Starts of initial values that the job leaves to the data.
void guess_starts(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                  EstimateSetup& setup) {
    for (std::size_t i = 0; i < setup.initial[experiment].size(); ++i) {
        const auto& indices = setup.initial[experiment][i];
        for (std::size_t b = 0; b < indices.size(); ++b) {
            estimator::FreeParameter& parameter = setup.parameters[static_cast<std::size_t>(indices[b])];
            if (!std::isnan(parameter.start)) continue;
            parameter.start = residual.guessed_state(b)[static_cast<Eigen::Index>(i)];
            const bool has_log = parameter.scale != estimator::Scale::log || parameter.start > 0.0;
            const bool allowed = parameter.lower <= parameter.start && parameter.start <= parameter.upper && has_log &&
                                 std::isfinite(estimator::negative_log_density(parameter.prior, parameter.start));
            if (allowed) continue;
            throw orbits::DataError(
                fmt::format("{}: the data suggest {} for {}, which its scale, bounds or prior do not allow: give it a "
                            "\"start\" in \"initial_state\"",
                            job.data[experiment].name, parameter.start, parameter.name));
        }
    }
}

}  // namespace

std::unique_ptr<orbits::SeriesResidual> single_shooting(const Job& job, std::size_t experiment,
                                                        const EstimateSetup& setup, const Experiment& measured) {
    const orbits::Series& series = measured.series;
    const DataJob& data = job.data[experiment];
    orbits::SeriesResidualOptions options;
    options.name = job.estimate->series->data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    options.inputs = measured.inputs;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(job.model.coordinate(coordinate).name);
        const auto& errors = job.estimate->series->errors;
        const auto error = std::find_if(errors.begin(), errors.end(),
                                        [&](const ErrorJob& one) { return one.coordinate == coordinate; });
        // With nodes, the rate of a difference sensor has no errors of its own.
        options.errors.push_back(error == errors.end() ? estimator::ErrorScale{true, 0.0, estimator::FlatPrior{}}
                                                       : error->scale);
        options.forms.push_back(error == errors.end() ? orbits::ErrorForm{} : error_form(*error));
    }
    options.covariances = joint_covariances(job.estimate->series->covariances, data.observe);
    options.segments = fitted_segments(series, data);
    for (std::size_t i = 0; i < data.initial_state.size(); ++i)
        options.initial.push_back(initial_rule(data.initial_state[i], setup.initial[experiment][i]));
    options.start = setup.start();
    try {
        return std::make_unique<orbits::SeriesResidual>(job.model.system, setup.experiments[experiment], series,
                                                        options);
    } catch (const std::invalid_argument& error) {
        throw orbits::DataError(fmt::format("{}: {}", data.name, error.what()));
    }
}

std::vector<estimator::Residual*> JobResiduals::all() const {
    std::vector<estimator::Residual*> list;
    if (cycles) list.push_back(cycles.get());
    for (const auto& residual : series)
        list.push_back(residual.get());
    for (const auto& residual : shooting)
        list.push_back(residual.get());
    if (waveform.residual) list.push_back(waveform.residual.get());
    for (const auto& residual : prediction)
        list.push_back(residual.get());
    return list;
}

std::vector<std::vector<std::string>> fitted_labels(const Job& job, const std::vector<Experiment>& data) {
    std::vector<std::vector<std::string>> labels(job.data.size());
    if (!job.estimate->series) return labels;
    for (const std::size_t experiment : job.estimate->series->data) {
        const orbits::Series& series = data[experiment].series;
        for (const std::size_t segment : fitted_segments(series, job.data[experiment]))
            labels[experiment].push_back(series.segments[segment].label);
    }
    return labels;
}

orbits::CycleTargetOptions cycle_targets(const Job& whole) {
    const CyclesResidualJob& job = *whole.estimate->cycles;
    orbits::CycleTargetOptions targets;
    targets.periods = job.periods;
    targets.weights = job.covariance ? orbits::CycleWeights::covariance : orbits::CycleWeights::equal;
    targets.positions = job.positions;
    targets.multipliers = job.multipliers;
    targets.multiplier_error = job.multiplier_error;
    // Cycles of a file are states.
    if (!whole.orbits->file) targets.sensor = whole.data[whole.orbits->data].sensor;
    std::vector<Eigen::Index> coordinates;
    for (const ErrorJob& error : job.errors) {
        targets.errors.push_back(error.scale);
        targets.forms.push_back(error_form(error));
        coordinates.push_back(error.coordinate);
    }
    targets.covariances = joint_covariances(job.covariances, coordinates);
    return targets;
}

void add_series(const Job& job, const std::vector<Experiment>& data, EstimateSetup& setup, JobResiduals& residuals) {
    if (!job.estimate->series || job.estimate->series->interval) return;
    for (const std::size_t experiment : job.estimate->series->data) {
        residuals.series.push_back(single_shooting(job, experiment, setup, data[experiment]));
        residuals.experiments.push_back(experiment);
        guess_starts(job, experiment, *residuals.series.back(), setup);
    }
}

void check_enough_readings(const Job& job, const EstimateSetup& setup, const JobResiduals& residuals) {
    const bool counted = !residuals.series.empty() || !residuals.shooting.empty() || residuals.waveform.residual;
    if (residuals.cycles || !counted) return;
    std::size_t readings = 0;
    std::size_t initial_values = 0;
    std::vector<std::string_view> names;
    const auto add_name = [&](std::size_t experiment) {
        const std::string_view name = job.data[experiment].name;
        if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    };
    const auto add_block = [&](const estimator::BlockLayout& block) {
        // Matched nodes are no unknowns of their own: only those that end a segment are.
        readings += block.linked_from < 0 ? block.group.size() : static_cast<std::size_t>(block.linked_from);
        if (block.next < 0) initial_values += static_cast<std::size_t>(block.latents);
    };
    for (std::size_t i = 0; i < residuals.series.size(); ++i) {
        add_name(residuals.experiments[i]);
        std::for_each(residuals.series[i]->layout().begin(), residuals.series[i]->layout().end(), add_block);
    }
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        add_name(residuals.shooting_experiments[i]);
        std::for_each(residuals.shooting[i]->layout().begin(), residuals.shooting[i]->layout().end(), add_block);
    }
    for (std::size_t b = 0; b < residuals.waveform.places.size(); ++b) {
        add_name(residuals.waveform.places[b].experiment);
        add_block(residuals.waveform.residual->layout()[b]);
    }
    const auto free = std::count_if(setup.parameters.begin(), setup.parameters.end(),
                                    [](const auto& parameter) { return !estimator::is_proper(parameter.prior); });
    const std::size_t unknowns = static_cast<std::size_t>(free) + initial_values;
    if (readings > unknowns) return;
    throw orbits::DataError(
        fmt::format("{}: too short: {} readings for {} free parameters and {} initial values, phases and offsets; at "
                    "least {} are needed",
                    fmt::join(names, ", "), readings, free, initial_values, unknowns + 1));
}

}  // namespace orbid::apps
