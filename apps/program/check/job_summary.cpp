#include "apps/program/check/job_summary.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/evaluated_model.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/counted_noun.hpp"

namespace orbid::apps {

namespace {

constexpr double bytes_per_megabyte = 1e6;

std::string data_line(const Job& job, const DataJob& data) {
    if (data.file) {
        const std::string count = data.file->pattern.empty() ? "" : counted(data.file->paths.size(), "file") + ", ";
        return fmt::format("  read       {}: {} ({}{:.3g} MB)\n", data.name, data.file->shown(), count,
                           data.file->bytes() / bytes_per_megabyte);
    }
    const SimulationJob& simulation = *data.simulation;
    const bool section = simulation.sampling == orbits::Series::Sampling::section;
    const std::size_t points = section ? simulation.sections : simulation.count * simulation.trajectories;
    const auto values = static_cast<double>(points) * static_cast<double>(job.model.system->dimension());
    return fmt::format("  simulate   {}: {} on {}, {:.3g} MB\n", data.name,
                       counted(points, section ? "section" : "sample"), counted(simulation.trajectories, "trajectory"),
                       values * static_cast<double>(sizeof(double)) / bytes_per_megabyte);
}

std::string section_line(const Job& job) {
    const auto& coordinate = job.model.coordinate(job.section_plane->coordinate);
    return fmt::format("  section    {} = {}, {}\n", coordinate.name, job.section_plane->value,
                       job.section_plane->direction > 0 ? "rising" : "falling");
}

std::string input_line(const Job& job, const DataJob& data) {
    std::vector<std::string_view> names;
    for (const models::Coordinate& input : job.model.system->inputs())
        names.push_back(input.name);
    return fmt::format(
        "  inputs     {}: {} from {}, {}\n", data.name, fmt::join(names, ", "),
        std::filesystem::path(data.inputs->file ? data.inputs->file->string() : data.file->shown()).filename().string(),
        models::name(data.inputs->interpolation));
}

std::string periods_text(const std::vector<int>& periods) {
    return fmt::format("{}", fmt::join(periods, ", "));
}

std::string periodic_lines(const Job& job) {
    const PeriodicJob& periodic = *job.periodic;
    std::string text;
    std::string method = periodic_method_names[periodic.method.index()];
    std::replace(method.begin(), method.end(), '_', ' ');
    if (!periodic.orbits.empty()) {
        std::size_t points = 0;
        for (const OrbitStart& start : periodic.orbits)
            points += static_cast<std::size_t>(start.points.cols());
        text += fmt::format("  periodic   {} orbit{} of {} point{} by {}{}\n", periodic.orbits.size(),
                            periodic.orbits.size() == 1 ? "" : "s", points, points == 1 ? "" : "s", method,
                            periodic.stability ? ", with stability" : "");
    }
    const auto n = static_cast<double>(job.model.system->dimension());
    const auto megabytes = [&](double points) {
        return points * n * static_cast<double>(sizeof(double)) / bytes_per_megabyte;
    };
    if (periodic.search)
        text += fmt::format("  search     periods {} of the model: {} of the section on {}, {:.3g} MB\n",
                            periods_text(periodic.search->periods), counted(periodic.search->points, "point"),
                            counted(periodic.search->trajectories, "trajectory"),
                            megabytes(static_cast<double>(periodic.search->points)));
    if (periodic.continuation) {
        const periodic::ContinuationOptions& options = periodic.continuation->options;
        const auto& parameter = job.model.parameter(options.parameter);
        // A point keeps the Jacobians of its orbit as well: n columns more.
        const double most = static_cast<double>(options.maximum_branches * options.maximum_points) *
                            static_cast<double>(options.maximum_period) * (n + 1.0);
        text += fmt::format(
            "  branches   {} from {} to {} {}, orbits up to period {}; at most {} branches of {} points, "
            "{:.3g} MB\n",
            parameter.name, options.lower, options.upper, parameter.unit, options.maximum_period,
            options.maximum_branches, options.maximum_points, megabytes(most));
    }
    return text;
}

std::string series_line(const Job& job) {
    const SeriesResidualJob& series = *job.estimate->series;
    std::vector<std::string> names;
    for (const std::size_t index : series.data)
        names.push_back(job.data[index].name);
    std::string text = fmt::format("  series     {}: ", fmt::join(names, ", "));
    if (!series.interval)
        return text + fmt::format("one trajectory per segment{}\n",
                                  series.unless_errors_grow ? ", nodes where errors grow along it" : "");
    text += *series.interval == SeriesResidualJob::automatic_interval
                ? (series.matching.kind == MatchingJob::Kind::diffusion ? "a node at every reading"
                                                                        : "nodes as far apart as errors allow")
                : fmt::format("a node every {} points", *series.interval);
    switch (series.matching.kind) {
        case MatchingJob::Kind::given:
            return text + fmt::format(", matched with a sd of {:.3g} of the range\n", series.matching.sd);
        case MatchingJob::Kind::estimated:
            return text + ", matched with a sd that is estimated\n";
        case MatchingJob::Kind::exact:
            return text + ", matched exactly\n";
        case MatchingJob::Kind::diffusion:
            return text + ", process noise between them is estimated\n";
        case MatchingJob::Kind::automatic:
            break;
    }
    return text + "\n";
}

std::string estimate_lines(const Job& job) {
    const EstimateJob& estimate = *job.estimate;
    std::vector<std::string> names;
    for (const FreeParameterJob& free : estimate.parameters)
        names.push_back(free.value.name);
    std::vector<std::string> stages;
    for (const StageJob& stage : estimate.strategy)
        stages.push_back((stage.if_needed ? "if needed " : "") + stage.name() +
                         (stage.kind == StageJob::Kind::prediction && estimate.scan ? " with a scan" : ""));
    std::string text = fmt::format("  estimate   {} from {}\n",
                                   names.empty() ? "error scales only" : fmt::format("{}", fmt::join(names, ", ")),
                                   fmt::join(stages, ", then "));
    if (estimate.series) text += series_line(job);
    const CriticismJob& criticism = estimate.criticism;
    std::vector<std::string> models;
    for (const std::string& variant : criticism.variants)
        models.push_back("variant " + variant);
    for (const Eigen::Index parameter : criticism.without)
        models.push_back(fmt::format("without {}", job.model.parameter(parameter).name));
    if (!models.empty()) text += fmt::format("  against    {}\n", fmt::join(models, ", "));
    if (criticism.held_out > 0.0) text += fmt::format("  held out   {:.3g} of the data in turn\n", criticism.held_out);
    return text;
}

}  // namespace

std::string job_summary(const Job& job) {
    std::string text = fmt::format("{}\n  model      {}{}{}\n", job.title.empty() ? job.source.string() : job.title,
                                   job.model.name, job.model.variant.empty() ? "" : ", variant ", job.model.variant);
    if (job.model.equations) text += fmt::format("  equations  {}\n", planned_evaluation(job));
    if (job.section_plane) text += section_line(job);
    if (job.stepper == FlowStepper::odeint) text += "  flows      by Boost.Odeint\n";
    for (const DataJob& data : job.data) {
        text += data_line(job, data);
        if (data.inputs) text += input_line(job, data);
    }
    if (job.orbits && job.orbits->file) text += fmt::format("  orbits     from {}\n", job.orbits->file->string());
    if (job.orbits && !job.orbits->file)
        text += fmt::format("  orbits     periods {} in {}\n", periods_text(job.orbits->search.periods),
                            job.data[job.orbits->data].name);
    if (job.periodic) text += periodic_lines(job);
    if (job.estimate) text += estimate_lines(job);
    return text;
}

}  // namespace orbid::apps
