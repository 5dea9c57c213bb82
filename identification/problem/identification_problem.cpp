#include "identification/problem/identification_problem.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace orbid::identification {

namespace {

using Sampling = orbits::Series::Sampling;
using Index = Eigen::Index;

void refuse_unless(bool rule, const std::string& text) {
    if (!rule) throw std::invalid_argument(text);
}

/// Coordinates of the model that the series has, ascending.
std::vector<Index> coordinates_of(const models::System& system, const orbits::Series& series) {
    std::vector<Index> found;
    const auto all = system.coordinates();
    for (std::size_t i = 0; i < all.size(); ++i)
        if (std::any_of(series.coordinates.begin(), series.coordinates.end(),
                        [&](const orbits::SeriesCoordinate& one) { return one.name == all[i].name; }))
            found.push_back(static_cast<Index>(i));
    return found;
}

void complete(const IdentificationProblem& problem, Experiment& experiment) {
    const auto dimension = static_cast<std::size_t>(problem.system->dimension());
    if (experiment.observe.empty() && experiment.series)
        experiment.observe = coordinates_of(*problem.system, *experiment.series);
    refuse_unless(!experiment.observe.empty(),
                  fmt::format("experiment {}: its series has no coordinate of the model {}", experiment.name,
                              problem.system->name()));
    for (const Index coordinate : experiment.observe)
        refuse_unless(coordinate >= 0 && coordinate < problem.system->dimension(),
                      fmt::format("experiment {}: observed coordinate {}: must be in [0, {})", experiment.name,
                                  coordinate, dimension));
    if (experiment.initial_state.empty()) experiment.initial_state.resize(dimension);
    refuse_unless(experiment.initial_state.size() == dimension,
                  fmt::format("experiment {}: {} initial values for {} coordinates", experiment.name,
                              experiment.initial_state.size(), dimension));
}

/// Experiments of one sampling.
std::vector<std::size_t> sampled(const IdentificationProblem& problem, Sampling sampling) {
    std::vector<std::size_t> found;
    for (std::size_t e = 0; e < problem.experiments.size(); ++e)
        if (problem.experiments[e].series && problem.experiments[e].series->sampling == sampling) found.push_back(e);
    return found;
}

/// Errors of every coordinate that one of the experiments observes.
std::vector<RecordErrors> usual_errors(const IdentificationProblem& problem, const std::vector<std::size_t>& data) {
    std::vector<RecordErrors> errors;
    for (Index coordinate = 0; coordinate < problem.system->dimension(); ++coordinate) {
        const bool observed = std::any_of(data.begin(), data.end(), [&](std::size_t e) {
            const auto& list = problem.experiments[e].observe;
            return std::find(list.begin(), list.end(), coordinate) != list.end();
        });
        if (observed)
            errors.push_back({coordinate, {true, 0.0, estimator::FlatPrior{}}, estimator::NormalErrors{}, 0.0, {}});
    }
    return errors;
}

void check_experiments(const IdentificationProblem& problem, const std::vector<std::size_t>& data) {
    for (const std::size_t index : data) {
        refuse_unless(index < problem.experiments.size(),
                      fmt::format("experiment {}: there are {}", index, problem.experiments.size()));
        refuse_unless(problem.experiments[index].series != nullptr,
                      fmt::format("experiment {}: has no series", problem.experiments[index].name));
    }
}

void complete_series(const IdentificationProblem& problem, SeriesChoice& series) {
    // Samples where there are some: sections beside them are usually there to be searched for cycles.
    if (series.data.empty()) series.data = sampled(problem, Sampling::samples);
    if (series.data.empty()) series.data = sampled(problem, Sampling::section);
    refuse_unless(!series.data.empty(), "a series is to be used: there is no experiment");
    check_experiments(problem, series.data);
    if (series.errors.empty()) series.errors = usual_errors(problem, series.data);
    // Sections are followed from one to the next.
    const bool sections = problem.experiments[series.data.front()].series->sampling == Sampling::section;
    if (sections && !series.interval) series.interval = SeriesChoice::automatic_interval;
}

void complete_waveform(const IdentificationProblem& problem, WaveformChoice& waveform) {
    if (waveform.data.empty()) waveform.data = sampled(problem, Sampling::samples);
    refuse_unless(!waveform.data.empty(), "waveforms are to be used: there is no sampled experiment");
    check_experiments(problem, waveform.data);
    if (waveform.errors.empty()) waveform.errors = usual_errors(problem, waveform.data);
    if (waveform.experiments.empty()) waveform.experiments.resize(waveform.data.size());
    refuse_unless(waveform.experiments.size() == waveform.data.size(),
                  fmt::format("{} waveforms for {} experiments", waveform.experiments.size(), waveform.data.size()));
    for (WaveformChoice::Experiment& one : waveform.experiments)
        if (one.offsets.empty()) one.offsets.resize(waveform.errors.size());
}

void check_branch(const IdentificationProblem& problem, const BranchChoice& branch) {
    const auto count = static_cast<Index>(problem.system->parameters().size());
    refuse_unless(branch.parameter >= 0 && branch.parameter < count,
                  fmt::format("branch over parameter {}: the model has {}", branch.parameter, count));
    const auto estimated = [&](const FreeModelParameter& free) { return free.parameter == branch.parameter; };
    refuse_unless(std::none_of(problem.parameters.begin(), problem.parameters.end(), estimated),
                  fmt::format("branch over {}: it is estimated too", problem.parameter(branch.parameter).name));
    const auto channels = std::ssize(branch.channels);
    refuse_unless(branch.at.size() > 0 && branch.at.allFinite(), "branch: needs values of its parameter");
    refuse_unless(branch.at_sd >= 0.0 && std::isfinite(branch.at_sd),
                  fmt::format("branch: the sd of its parameter is {}, must be >= 0 and finite", branch.at_sd));
    refuse_unless(branch.values.rows() == channels && branch.values.cols() == branch.at.size(),
                  fmt::format("branch: values have shape ({}, {}), must be ({}, {}): channels, motions",
                              branch.values.rows(), branch.values.cols(), channels, branch.at.size()));
    refuse_unless(!branch.range || branch.range->first < branch.range->second, "branch: its range must ascend");
}

/// What is used when nothing is named.
void choose_residuals(IdentificationProblem& problem) {
    if (problem.cycles || problem.series || problem.waveform || problem.branch) return;
    if (!problem.measured.search.cycles.empty()) {
        problem.cycles.emplace();
        if (const auto searched = problem.measured.experiment)
            problem.cycles->sensor = problem.experiments[*searched].sensor;
    }
    if (!problem.experiments.empty()) problem.series.emplace().interval = SeriesChoice::automatic_interval;
    problem.cycles_if_needed = problem.cycles && problem.series;
    refuse_unless(problem.cycles || problem.series, "there is nothing to estimate from: no cycles and no experiment");
}

/// A prediction starts from states that readings say.
bool has_readings(const IdentificationProblem& problem) {
    const auto by_formulas = [&](std::size_t index) {
        return problem.experiments[index].sensor.type == models::Sensor::Type::function;
    };
    if (problem.series && std::any_of(problem.series->data.begin(), problem.series->data.end(), by_formulas))
        return false;
    return (problem.series && !problem.series->data.empty()) || problem.measured.experiment;
}

}  // namespace

void set_default_bounds(const models::Parameter& entry, estimator::FreeParameter& free) {
    // Bounds are inclusive and 0 is no positive number: on a linear scale this share of the typical size is the least.
    constexpr double smallest_positive_share = 1e-9;
    constexpr double infinity = std::numeric_limits<double>::infinity();
    // The end of a logarithmic scale is never reached.
    const bool log_scale = free.scale == estimator::Scale::log || free.scale == estimator::Scale::log10;
    const bool positive = entry.domain == models::Domain::positive;
    free.lower = entry.domain == models::Domain::real && !log_scale ? -infinity : 0.0;
    if (positive && !log_scale) free.lower = smallest_positive_share * entry.typical_size;
    free.upper = infinity;
}

estimator::FreeParameter free_parameter(const models::Parameter& entry, double start) {
    estimator::FreeParameter free;
    free.name = entry.name;
    free.unit = entry.unit;
    free.start = start;
    free.typical_size = entry.typical_size;
    free.scale = entry.domain == models::Domain::positive ? estimator::Scale::log : estimator::Scale::linear;
    set_default_bounds(entry, free);
    return free;
}

FreeModelParameter free_parameter(const models::System& system, const std::string& name, double start) {
    const auto all = system.parameters();
    const auto entry =
        std::find_if(all.begin(), all.end(), [&](const models::Parameter& one) { return one.name == name; });
    refuse_unless(entry != all.end(), fmt::format("model {}: has no parameter {}", system.name(), name));
    return {static_cast<Index>(entry - all.begin()), free_parameter(*entry, start)};
}

IdentificationProblem completed(IdentificationProblem problem) {
    refuse_unless(problem.system != nullptr, "a problem needs a system");
    const models::System& system = *problem.system;
    const auto count = static_cast<Index>(system.parameters().size());
    if (problem.values.size() == 0) problem.values = system.default_parameters();
    refuse_unless(problem.values.size() == count, fmt::format("{} values for {} parameters of the model {}",
                                                              problem.values.size(), count, system.name()));
    for (FreeModelParameter& free : problem.parameters) {
        refuse_unless(free.parameter >= 0 && free.parameter < count,
                      fmt::format("parameter {}: the model {} has {}", free.parameter, system.name(), count));
        if (!free.value.name.empty()) continue;
        free.value.name = problem.parameter(free.parameter).name;
        free.value.unit = problem.parameter(free.parameter).unit;
    }
    for (Experiment& experiment : problem.experiments)
        complete(problem, experiment);
    if (const auto searched = problem.measured.experiment) check_experiments(problem, {*searched});
    choose_residuals(problem);
    if (problem.series) complete_series(problem, *problem.series);
    if (problem.waveform) complete_waveform(problem, *problem.waveform);
    if (problem.branch) check_branch(problem, *problem.branch);
    return problem;
}

std::vector<Stage> automatic_strategy(const StrategyData& data) {
    using Kind = Stage::Kind;
    std::vector<Stage> stages;
    if (data.readings) stages.push_back({Kind::prediction, {}});
    // Without a prediction a series begins at the start itself, where cycles are the safer way.
    const bool if_needed = data.cycles && data.series && data.readings && data.cycles_if_needed;
    if (if_needed) stages.push_back({Kind::residuals, {ResidualType::series}});
    if (data.cycles) stages.push_back({Kind::residuals, {ResidualType::cycles}, if_needed});
    if (data.cycles && data.searched) stages.push_back({Kind::harvest, {ResidualType::cycles}, if_needed});
    if (data.series) stages.push_back({Kind::residuals, {ResidualType::series}, if_needed});
    if (data.waveform) stages.push_back({Kind::residuals, {ResidualType::waveform}});
    if (data.branch) stages.push_back({Kind::residuals, {ResidualType::branch}});
    return stages;
}

std::vector<Stage> automatic_strategy(const IdentificationProblem& problem) {
    const bool cycles = problem.cycles.has_value();
    const bool series = problem.series.has_value();
    const bool searched = problem.measured.experiment && (problem.measured.section || problem.measured.find);
    return automatic_strategy(StrategyData{(cycles || series) && has_readings(problem), cycles, searched, series,
                                           problem.waveform.has_value(), problem.branch.has_value(),
                                           problem.cycles_if_needed});
}

void check_strategy(const IdentificationProblem& problem, const std::vector<Stage>& strategy) {
    bool series_before = false;
    for (const Stage& stage : strategy) {
        refuse_unless(
            !stage.if_needed || series_before,
            fmt::format("strategy: stage {}: is run if needed, so a stage series must come before it", stage.name()));
        series_before = series_before || (!stage.if_needed && stage.is_series());
        const bool predicts = stage.kind == Stage::Kind::prediction;
        refuse_unless(!predicts || has_readings(problem),
                      "strategy: a prediction needs a series that is not read by formulas, or an experiment that was "
                      "searched for cycles");
        refuse_unless(predicts || !stage.residuals.empty(), "strategy: a stage names no residuals");
        const bool there = (!stage.uses(ResidualType::cycles) || problem.cycles) &&
                           (!stage.uses(ResidualType::series) || problem.series) &&
                           (!stage.uses(ResidualType::waveform) || problem.waveform) &&
                           (!stage.uses(ResidualType::branch) || problem.branch);
        refuse_unless(there, fmt::format("strategy: stage {}: the problem does not use such data", stage.name()));
    }
}

std::string Stage::name() const {
    if (kind == Kind::prediction) return "prediction";
    if (kind == Kind::harvest) return "harvest";
    static constexpr std::array<std::string_view, 4> words{"cycles", "series", "waveform", "branch"};
    std::string text;
    for (const ResidualType type : residuals)
        text += fmt::format("{}{}", text.empty() ? "" : " + ", words[static_cast<std::size_t>(type)]);
    return text;
}

}  // namespace orbid::identification
