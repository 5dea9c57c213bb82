#include "apps/report/plots/plot_catalog.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "apps/drawing/plot_axis.hpp"
#include "apps/report/plots/catalog_plots.hpp"

namespace orbid::apps {

namespace {

struct Entry {
    std::string_view name;
    std::string_view title;
    std::string_view description;
    bool (*available)(const StoredRun&);
    std::string (*draw)(const StoredRun&, const PlotStyle&);
};

constexpr std::array entries{
    Entry{"section", "Section", "The points of the section, darker where they are dense, with its periodic points.",
          catalog::has_section, catalog::section},
    Entry{"cycles", "Periodic points", "The periodic points by period: measured ones, or those of the model.",
          catalog::has_cycles, catalog::cycles},
    Entry{"multipliers", "Multipliers", "The largest multiplier of each periodic orbit, measured and of the model.",
          catalog::has_multipliers, catalog::multipliers},
    Entry{"branch", "Branches", "Periodic orbits over a parameter, stable ones solid, with their bifurcations.",
          catalog::has_branch, catalog::branch},
    Entry{"parameters", "Parameters", "Estimates with their 95 % intervals, as deviations from the known values.",
          catalog::has_parameters, catalog::parameters},
    Entry{"convergence", "Convergence", "By how much each step lowered the objective; the way from stage to stage.",
          catalog::has_convergence, catalog::convergence},
    Entry{"correlation", "Correlation", "Correlations of the estimates: near +-1 the data tell a combination only.",
          catalog::has_correlation, catalog::correlation},
    Entry{"singular_values", "Singular values", "How well each direction of the parameters is determined.",
          catalog::has_singular_values, catalog::singular_values},
    Entry{"profiles", "Profiles", "Likelihood along each parameter, the others at their best; dashed: normal.",
          catalog::has_profiles, catalog::profiles},
    Entry{"marginals", "Marginal densities", "Posterior density of each parameter beside the normal approximation.",
          catalog::has_marginals, catalog::marginals},
    Entry{"posterior", "Posterior", "Draws from the posterior, the parameters in pairs.", catalog::has_posterior,
          catalog::posterior},
    Entry{"residuals", "Residuals", "Residuals over their sd, record by record; 95 % should lie in the band.",
          catalog::has_residuals, catalog::residuals},
    Entry{"normal_quantiles", "Normal quantiles", "Distribution of the residuals: normal ones follow the line.",
          catalog::has_residuals, catalog::normal_quantiles},
    Entry{"prediction", "Predicted against measured", "The records over time, and what the estimate makes of them.",
          catalog::has_prediction, catalog::prediction},
    Entry{"waveform", "Steady states", "Measured steady states and computed ones over one turn of the orbit.",
          catalog::has_waveform, catalog::waveform},
    Entry{"evidence", "Evidence", "Logarithms of the Bayes factors against the other models.", catalog::has_evidence,
          catalog::evidence}};

}  // namespace

std::vector<AvailablePlot> available_plots(const StoredRun& run) {
    std::vector<AvailablePlot> list;
    for (const Entry& entry : entries)
        if (entry.available(run))
            list.push_back({std::string(entry.name), std::string(entry.title), std::string(entry.description)});
    return list;
}

std::vector<std::string> plot_names() {
    std::vector<std::string> names;
    for (const Entry& entry : entries)
        names.emplace_back(entry.name);
    return names;
}

std::string plot_svg(const StoredRun& run, std::string_view name, const PlotStyle& style) {
    std::vector<std::string> names;
    for (const Entry& entry : entries) {
        if (!entry.available(run)) {
            if (entry.name == name)
                throw std::invalid_argument(fmt::format("{}: no data for the plot \"{}\"", run.folder.string(), name));
            continue;
        }
        if (entry.name == name) return entry.draw(run, style);
        names.emplace_back(entry.name);
    }
    throw std::invalid_argument(fmt::format("there is no plot \"{}\"{}", name, suggestion(std::string(name), names)));
}

namespace catalog {

double number(const StoredRun::Json& object, const char* key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_number() ? found->get<double>()
                                                       : std::numeric_limits<double>::quiet_NaN();
}

std::string quantity_name(const std::string& name) {
    constexpr std::string_view over = "_over_";
    const auto at = name.find(over);
    if (at != std::string::npos && at > 0 && at + over.size() < name.size())
        return display_name(name.substr(0, at)) + "/" + display_name(name.substr(at + over.size()));
    return display_name(name);
}

}  // namespace catalog

}  // namespace orbid::apps
