#include "apps/report/plots/plot_catalog.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "apps/drawing/chart_picture.hpp"
#include "apps/report/plots/record_charts.hpp"
#include "apps/report/plots/residual_structure.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

bool has_section(const StoredRun& run) {
    const auto experiments = run.experiments();
    if (run.cycles && run.cycles->at("coordinates").size() < 2) return false;
    // Samples show a section only where the job says which.
    const bool cut = run.job.contains("orbits") && !run.job["orbits"].contains("file");
    for (const Json* experiment : experiments) {
        if (const Json& simulate = block_at(*experiment, "simulate"); !simulate.empty()) {
            const std::string name =
                experiments.size() == 1 ? std::string("series") : "series_" + text_at(*experiment, "name");
            if ((simulate.contains("sections") || cut) && (std::filesystem::exists(run.folder / (name + ".h5")) ||
                                                           std::filesystem::exists(run.folder / (name + ".csv"))))
                return true;
        } else if (experiment->contains("file") && (text_at(*experiment, "kind") == "section" || cut)) {
            if (std::filesystem::exists(run.folder / text_at(*experiment, "file"))) return true;
        }
    }
    return false;
}

bool has_cycles(const StoredRun& run) {
    const Json* list = run.cycles ? &*run.cycles : run.orbits ? &*run.orbits : nullptr;
    return !block_at(list, "cycles").empty() && list->at("coordinates").size() >= 2;
}

bool has_branch(const StoredRun& run) {
    return !block_at(run.shown_branch(), "branches").empty();
}

bool has_marginals(const StoredRun& run) {
    const Json& list = block_at(run.result, "marginals");
    return std::any_of(list.begin(), list.end(), [](const Json& one) {
        return one.is_object() && one.value("known", false) && !block_at(one, "points").empty();
    });
}

bool has_posterior(const StoredRun& run) {
    return run.result && std::filesystem::exists(run.folder / "posterior.csv");
}

bool has_residuals(const StoredRun& run) {
    std::error_code missing;
    // A header alone has fewer bytes.
    constexpr std::uintmax_t header = 90;
    const auto bytes = std::filesystem::file_size(run.folder / "residuals.csv", missing);
    return !missing && bytes > header;
}

bool has_prediction(const StoredRun& run) {
    // A job of cycles alone has no series to show.
    const Json& list = block_at(block_at(run.job, "estimate"), "residuals");
    return has_residuals(run) &&
           std::any_of(list.begin(), list.end(), [](const Json& one) { return text_at(one, "type") != "cycles"; });
}

bool has_waveform(const StoredRun& run) {
    return has_residuals(run) && !block_at(run.result, "steady_states").empty();
}

/// What result.json or a list of cycles holds is looked at itself.
template <Chart (*make)(const StoredRun&)>
bool has_views(const StoredRun& run) {
    return !make(run).views.empty();
}

template <Chart (*make)(const std::vector<RecordGroup>&)>
Chart of_records(const StoredRun& run) {
    const auto rows = catalog::rows_of(run);
    return make(record_groups(run, rows));
}

template <Chart (*make)(const StoredRun&, const std::optional<StoredDraws>&)>
Chart of_draws(const StoredRun& run) {
    return make(run, stored_draws(run));
}

Chart waveform_of(const StoredRun& run) {
    return waveform_chart(run, catalog::rows_of(run));
}

/// Charts that need every row.
template <Chart (*make)(const std::vector<RecordGroup>&)>
Chart all_records(const StoredRun& run) {
    const auto rows = catalog::rows_of(run);
    return make(record_groups(run, rows, rows.size()));
}

Chart dependence_of(const StoredRun& run) {
    const auto rows = catalog::rows_of(run);
    return dependence_chart(run, record_groups(run, rows));
}

/// Records of few readings, or at their own times, have none of these.
template <Chart (*make)(const StoredRun&)>
bool has_any(const StoredRun& run) {
    return has_residuals(run) && !make(run).views.empty();
}

bool has_predicted_segments(const StoredRun& run) {
    return std::filesystem::exists(run.folder / "predictions.csv");
}

Chart segments_of(const StoredRun& run) {
    const auto rows = stored_predictions(run);
    return segment_chart(record_groups(run, rows, rows.size()));
}

struct Entry {
    std::string_view name;
    std::string_view description;
    bool (*available)(const StoredRun&);
    Chart (*chart)(const StoredRun&);
};

constexpr std::array entries{
    Entry{"section", "The points of the section, darker where they are dense, with its periodic points.", has_section,
          section_chart},
    Entry{"cycles", "The periodic points by period: measured ones, or those of the model.", has_cycles, cycle_chart},
    Entry{"multipliers", "The largest multiplier of each periodic orbit, measured and of the model.",
          has_views<multiplier_chart>, multiplier_chart},
    Entry{"branch", "Periodic orbits over a parameter, stable ones solid; measured motions beside the fitted branch.",
          has_branch, branch_chart},
    Entry{"parameters", "Estimates with their 95 % intervals, as deviations from the known values.",
          has_views<parameter_chart>, parameter_chart},
    Entry{"convergence", "The objective above its last value, step by step; the way from stage to stage.",
          has_views<convergence_chart>, convergence_chart},
    Entry{"correlation", "Correlations of the estimates: near +-1 the data tell a combination only.",
          has_views<correlation_chart>, correlation_chart},
    Entry{"singular_values", "How well each direction of the parameters is determined.",
          has_views<singular_value_chart>, singular_value_chart},
    Entry{"profiles", "Likelihood along each parameter, the others at their best; dashed: normal.",
          has_views<profile_chart>, profile_chart},
    Entry{"marginals", "Posterior density of each parameter beside the normal approximation.", has_marginals,
          of_draws<marginal_chart>},
    Entry{"posterior", "Draws from the posterior, the parameters in pairs.", has_posterior, of_draws<posterior_chart>},
    Entry{"residuals", "Residuals over their sd, record by record; 95 % should lie within the dashed lines.",
          has_residuals, of_records<residual_chart>},
    Entry{"normal_quantiles", "Distribution of the residuals: normal ones follow the line.", has_residuals,
          of_records<quantile_chart>},
    Entry{"autocorrelation", "How residuals follow each other, beside the band of white noise.",
          has_any<all_records<autocorrelation_chart>>, all_records<autocorrelation_chart>},
    Entry{"residual_spectrum", "Power of the residuals by frequency; 1 for white noise.",
          has_any<all_records<spectrum_chart>>, all_records<spectrum_chart>},
    Entry{"residual_dependence", "Residuals against measured inputs, states and their rates; means at 0 are right.",
          has_any<dependence_of>, dependence_of},
    Entry{"predicted_segments", "Segments that were predicted: measured, predicted, and the error.",
          has_predicted_segments, segments_of},
    Entry{"prediction", "The records over time, and what the estimate makes of them.", has_prediction,
          of_records<prediction_chart>},
    Entry{"waveform", "Measured steady states and computed ones over one turn of the orbit.", has_waveform,
          waveform_of},
    Entry{"evidence", "Logarithms of the Bayes factors against the other models.", has_views<evidence_chart>,
          evidence_chart}};

}  // namespace

std::vector<AvailablePlot> available_plots(const StoredRun& run) {
    std::vector<AvailablePlot> list;
    for (const Entry& entry : entries)
        if (entry.available(run)) list.push_back({std::string(entry.name), std::string(entry.description)});
    return list;
}

std::vector<std::string> plot_names() {
    std::vector<std::string> names;
    for (const Entry& entry : entries)
        names.emplace_back(entry.name);
    return names;
}

std::string plot_svg(const StoredRun& run, std::string_view name, const PlotStyle& style) {
    const auto* const entry =
        std::find_if(entries.begin(), entries.end(), [&](const Entry& one) { return one.name == name; });
    if (entry == entries.end()) {
        std::vector<std::string> names;
        for (const AvailablePlot& plot : available_plots(run))
            names.push_back(plot.name);
        throw std::invalid_argument(fmt::format("there is no plot \"{}\"{}", name, suggestion(name, names)));
    }
    if (!entry->available(run))
        throw std::invalid_argument(fmt::format("{}: no data for the plot \"{}\"", run.folder.string(), name));
    const Chart chart = entry->chart(run);
    if (chart.views.empty())
        throw orbits::DataError(fmt::format("{}: holds nothing to plot as \"{}\"", run.folder.string(), name));
    return chart_svg(chart, run.title(), style);
}

}  // namespace orbid::apps
