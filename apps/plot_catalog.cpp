#include "apps/plot_catalog.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/catalog_plots.hpp"
#include "apps/json_reader.hpp"
#include "apps/plot_axis.hpp"

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
    Entry{"parameters", "Parameters", "Estimates with their 95 % intervals, as deviations from the known values.",
          catalog::has_parameters, catalog::parameters},
    Entry{"correlation", "Correlation", "Correlations of the estimates: near +-1 the data tell a combination only.",
          catalog::has_correlation, catalog::correlation}};

}  // namespace

std::vector<AvailablePlot> available_plots(const StoredRun& run) {
    std::vector<AvailablePlot> list;
    for (const Entry& entry : entries) {
        if (entry.available(run))
            list.push_back({std::string(entry.name), std::string(entry.title), std::string(entry.description)});
    }
    return list;
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
