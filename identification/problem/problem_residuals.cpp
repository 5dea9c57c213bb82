#include "identification/problem/problem_residuals.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::identification {

orbits::ErrorForm error_form(const RecordErrors& error) {
    return {error.distribution, error.floor, !error.sd_column.empty()};
}

namespace {

orbits::InitialStateRule initial_rule(const InitialValue& job, const std::vector<Eigen::Index>& parameters) {
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
void guess_starts(const IdentificationProblem& problem, std::size_t experiment, const orbits::SeriesResidual& residual,
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
                            problem.experiments[experiment].name, parameter.start, parameter.name));
        }
    }
}

}  // namespace

std::unique_ptr<orbits::SeriesResidual> single_shooting(const IdentificationProblem& problem, std::size_t experiment,
                                                        const EstimateSetup& setup) {
    const Experiment& data = problem.experiments[experiment];
    const orbits::Series& series = *data.series;
    orbits::SeriesResidualOptions options;
    options.name = problem.series->data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    options.inputs = data.inputs;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(problem.coordinate(coordinate).name);
        const auto& errors = problem.series->errors;
        const auto error = std::find_if(errors.begin(), errors.end(),
                                        [&](const RecordErrors& one) { return one.coordinate == coordinate; });
        // With nodes, the rate of a difference sensor has no errors of its own.
        options.errors.push_back(error == errors.end() ? estimator::ErrorScale{true, 0.0, estimator::FlatPrior{}}
                                                       : error->scale);
        options.forms.push_back(error == errors.end() ? orbits::ErrorForm{} : error_form(*error));
    }
    options.covariances = joint_covariances(problem.series->covariances, data.observe);
    options.segments = data.fitted_segments();
    for (std::size_t i = 0; i < data.initial_state.size(); ++i)
        options.initial.push_back(initial_rule(data.initial_state[i], setup.initial[experiment][i]));
    options.start = setup.start();
    options.delay = setup.delay(data, experiment);
    try {
        return std::make_unique<orbits::SeriesResidual>(problem.system, setup.experiments[experiment], series, options);
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: {}", data.name, error.what()));
    }
}

std::vector<const estimator::Residual*> ProblemResiduals::all() const {
    std::vector<const estimator::Residual*> list;
    if (cycles) list.push_back(cycles.get());
    for (const auto& residual : series)
        list.push_back(residual.get());
    for (const auto& residual : shooting)
        list.push_back(residual.get());
    if (waveform.residual) list.push_back(waveform.residual.get());
    if (branch) list.push_back(branch.get());
    for (const auto& residual : prediction)
        list.push_back(residual.get());
    return list;
}

std::vector<std::unique_ptr<estimator::Residual>> ProblemResiduals::copies() const {
    std::vector<std::unique_ptr<estimator::Residual>> list;
    if (cycles) list.push_back(std::make_unique<orbits::CycleResidual>(*cycles));
    for (const auto& one : series)
        list.push_back(std::make_unique<orbits::SeriesResidual>(*one));
    for (const auto& one : shooting)
        list.push_back(std::make_unique<orbits::ShootingResidual>(*one));
    if (waveform.residual) list.push_back(std::make_unique<periodic::WaveformResidual>(*waveform.residual));
    if (branch) list.push_back(std::make_unique<periodic::BranchResidual>(*branch));
    for (const auto& one : prediction)
        list.push_back(std::make_unique<orbits::PredictionResidual>(*one));
    return list;
}

std::vector<std::shared_ptr<const models::System>> systems_with(const std::shared_ptr<const models::System>& system,
                                                                const Inputs& inputs) {
    std::vector<std::shared_ptr<const models::System>> systems;
    for (const auto& input : inputs)
        systems.push_back(system->with_input(input));
    if (systems.empty()) systems.push_back(system);
    return systems;
}

std::vector<std::vector<std::string>> fitted_labels(const IdentificationProblem& problem) {
    std::vector<std::vector<std::string>> labels(problem.experiments.size());
    if (!problem.series) return labels;
    for (const std::size_t experiment : problem.series->data) {
        const orbits::Series& series = *problem.experiments[experiment].series;
        for (const std::size_t segment : problem.experiments[experiment].fitted_segments())
            labels[experiment].push_back(series.segments[segment].label);
    }
    return labels;
}

void add_series(const IdentificationProblem& problem, EstimateSetup& setup, ProblemResiduals& residuals) {
    if (!problem.series || problem.series->interval) return;
    for (const std::size_t experiment : problem.series->data) {
        residuals.series.push_back(single_shooting(problem, experiment, setup));
        residuals.experiments.push_back(experiment);
        guess_starts(problem, experiment, *residuals.series.back(), setup);
    }
}

void check_enough_readings(const IdentificationProblem& problem, const EstimateSetup& setup,
                           const ProblemResiduals& residuals) {
    const bool counted =
        !residuals.series.empty() || !residuals.shooting.empty() || residuals.waveform.residual || residuals.branch;
    if (residuals.cycles || !counted) return;
    std::size_t readings = 0;
    std::size_t initial_values = 0;
    std::vector<std::string_view> names;
    const auto add_name = [&](std::size_t experiment) {
        const std::string_view name = problem.experiments[experiment].name;
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
    if (residuals.branch) {
        names.emplace_back("branch");
        std::for_each(residuals.branch->layout().begin(), residuals.branch->layout().end(), add_block);
    }
    const auto free = std::count_if(setup.parameters.begin(), setup.parameters.end(), [](const auto& parameter) {
        const bool held = parameter.lower == parameter.upper;
        return !held && !estimator::is_proper(parameter.prior);
    });
    const std::size_t unknowns = static_cast<std::size_t>(free) + initial_values;
    if (readings > unknowns) return;
    throw orbits::DataError(
        fmt::format("{}: too short: {} readings for {} free parameters and {} initial values, phases and offsets; at "
                    "least {} are needed",
                    fmt::join(names, ", "), readings, free, initial_values, unknowns + 1));
}

}  // namespace orbid::identification
