#include "apps/estimation/job_problem.hpp"

#include <algorithm>
#include <memory>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/flow_stepper.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_waveform.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::apps {

namespace {

/// Refers to what somebody else owns.
std::shared_ptr<const orbits::Series> borrowed(const orbits::Series& series) {
    return {std::shared_ptr<const orbits::Series>(), &series};
}

/// How the measured cycles are weighted, how their errors are distributed and how their points were read.
/// @param plane  coordinate that is the same at all points; -1: none
orbits::CycleTargetOptions cycle_targets(const Job& whole, Eigen::Index plane) {
    const CyclesResidualJob& job = *whole.estimate->cycles;
    orbits::CycleTargetOptions targets;
    targets.periods = job.periods;
    targets.weights = job.covariance ? orbits::CycleWeights::covariance : orbits::CycleWeights::equal;
    targets.positions = job.positions;
    targets.multipliers = job.multipliers;
    targets.multiplier_error = job.multiplier_error;
    targets.times = job.times;
    targets.time_error = job.time_error;
    // Cycles of a file are states.
    if (!whole.orbits->file) targets.sensor = whole.data[whole.orbits->data].sensor;
    std::vector<Eigen::Index> coordinates;
    for (const ErrorJob& error : job.errors) {
        if (error.coordinate == plane) continue;
        targets.errors.push_back(error.scale);
        targets.forms.push_back(identification::error_form(error));
        coordinates.push_back(error.coordinate);
    }
    targets.covariances = identification::joint_covariances(job.covariances, coordinates);
    return targets;
}

identification::Experiment identification_experiment(const DataJob& job, const Experiment* record) {
    identification::Experiment experiment;
    experiment.name = job.name;
    if (record != nullptr) {
        experiment.series = borrowed(record->series);
        experiment.inputs = record->inputs;
    }
    experiment.sensor = job.sensor;
    experiment.observe = job.observe;
    experiment.parameters = job.parameters;
    experiment.free = job.free;
    experiment.fit = job.fit;
    experiment.predict = job.predict;
    experiment.initial_state = job.initial_state;
    if (job.inputs) experiment.delay = job.inputs->delay_parameter;
    experiment.follows_model = job.simulation.has_value();
    return experiment;
}

}  // namespace

identification::BranchChoice measured_branch(const Job& job) {
    const BranchResidualJob& asked = *job.estimate->branch;
    identification::BranchChoice branch;
    orbits::TableLayout layout;
    const auto add = [&](std::string name, std::string unit, const ColumnJob& column, const std::string& sd) {
        layout.coordinates.push_back({{std::move(name), std::move(unit), false},
                                      column.column,
                                      column.unit,
                                      static_cast<double>(column.sign),
                                      column.offset,
                                      sd,
                                      column.factor});
    };
    const models::Parameter& parameter = job.model.parameter(asked.parameter);
    add(std::string(parameter.name), std::string(parameter.unit), asked.at, {});
    for (const BranchResidualJob::Measure& one : asked.measures) {
        const bool frequency = one.measure == periodic::OrbitMeasure::frequency;
        const std::string unit = frequency ? "Hz" : asked.quantity(*job.model.system, one.column.coordinate).second;
        add(fmt::format("{} {}", layout.coordinates.size(), periodic::name_of(one.measure)), unit, one.column,
            one.error.sd_column);
        branch.channels.push_back({one.measure, one.error});
        branch.channels.back().errors.coordinate = one.column.coordinate;
    }
    const orbits::Series table = orbits::read_csv(*asked.file, layout);
    const orbits::Segment& rows = table.segments.front();
    branch.parameter = asked.parameter;
    branch.at = rows.values.row(0);
    branch.at_sd = asked.at_sd;
    if (!branch.at.allFinite())
        throw orbits::DataError(fmt::format("{}: a value of {} is missing", asked.file->string(), parameter.name));
    const Eigen::Index count = rows.values.rows() - 1;
    branch.values = rows.values.bottomRows(count);
    if (rows.deviations.size() > 0) branch.deviations = rows.deviations.bottomRows(count);
    branch.start.points = asked.orbit.points;
    branch.start.rotation = asked.orbit.rotation;
    branch.start.time = asked.orbit.time;
    branch.start.section = job_section(job);
    branch.range = asked.range;
    branch.readings = asked.readings;
    return branch;
}

identification::IdentificationProblem identification_problem(const Job& job, std::span<const Experiment> data) {
    identification::IdentificationProblem problem;
    problem.system = job.model.system;
    problem.values = job.model.values;
    problem.parameters = job.estimate->parameters;
    problem.joint_priors = job.estimate->joint_priors;
    problem.derived = job.estimate->derived;
    for (std::size_t e = 0; e < job.data.size(); ++e)
        problem.experiments.push_back(identification_experiment(job.data[e], e < data.size() ? &data[e] : nullptr));
    if (job.estimate->cycles)
        problem.cycles = cycle_targets(job, job.section_plane ? job.section_plane->coordinate : -1);
    problem.series = job.estimate->series;
    problem.waveform = job.estimate->waveform;
    if (job.estimate->branch) problem.branch = measured_branch(job);
    problem.measured.section_phase = job.section_phase;
    problem.measured.plane = job_section(job);
    if (job.orbits && !job.orbits->file) problem.measured.experiment = job.orbits->data;
    return problem;
}

void add_measured_cycles(const Job& job, const SearchedSection* section, const orbits::CycleSearch& search,
                         identification::IdentificationProblem& problem) {
    problem.measured.search = search;
    if (section == nullptr) return;
    problem.measured.section = borrowed(section->series());
    problem.measured.options = section->options;
    problem.measured.experiment = job.orbits->data;
    if (section->plane && !job.orbits->embedding) {
        const Eigen::Index normal = job.model.system->coordinate_index(section->plane->coordinate);
        problem.measured.plane = models::Section{Eigen::VectorXd::Unit(job.model.system->dimension(), normal),
                                                 section->plane->value, section->plane->direction};
        if (problem.cycles) problem.cycles = cycle_targets(job, normal);
    }
    if (!problem.waveform || !problem.waveform->of_cycles) return;
    std::vector<Eigen::Index> rows;
    for (const identification::RecordErrors& error : problem.waveform->errors) {
        const auto name = job.model.coordinate(error.coordinate).name;
        const auto& coordinates = section->record->coordinates;
        const auto row = std::find_if(coordinates.begin(), coordinates.end(),
                                      [&](const orbits::SeriesCoordinate& one) { return one.name == name; });
        if (row == coordinates.end())
            throw orbits::DataError(
                fmt::format("{}: the series has no coordinate {}", job.data[job.orbits->data].name, name));
        rows.push_back(row - coordinates.begin());
    }
    problem.waveform->cycles = orbits::cycle_waveforms(*section->record, rows, section->series(), search.cycles);
}

identification::Options identification_options(const Job& job) {
    const EstimateJob& estimate = *job.estimate;
    identification::Options options;
    options.strategy = estimate.strategy;
    options.scan = estimate.scan;
    options.seed = job.seed;
    options.variance = estimate.variance;
    options.starts = estimate.multi_start.starts;
    options.start_seed = estimate.multi_start.seed;
    options.comparison.model = job.model.variant.empty() ? job.model.name : "variant " + job.model.variant;
    options.comparison.held_out = estimate.criticism.held_out;
    for (const std::string& variant : estimate.criticism.variants)
        options.comparison.alternatives.push_back(
            {"variant " + variant,
             with_stepper(models::make_system(job.model.name, variant, job.model.size), job.stepper)});
    for (const Eigen::Index parameter : estimate.criticism.without)
        options.comparison.alternatives.push_back(
            {fmt::format("without {}", job.model.parameter(parameter).name), nullptr, parameter});
    return options;
}

}  // namespace orbid::apps
