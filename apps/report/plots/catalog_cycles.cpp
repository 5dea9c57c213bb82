#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "apps/drawing/figure.hpp"
#include "apps/drawing/section_plot.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/results/cycle_reader.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "apps/stored_run/stored_section.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

const Json* cycle_list(const StoredRun& run) {
    if (run.cycles) return &*run.cycles;
    return run.orbits ? &*run.orbits : nullptr;
}

/// Coordinates of the section as the list of cycles names them.
std::vector<orbits::SeriesCoordinate> coordinates_of(const StoredRun& run, const Json& list) {
    const ModelJob model = stored_model(run);
    std::vector<orbits::SeriesCoordinate> coordinates;
    for (const Json& name : list.at("coordinates"))
        coordinates.push_back(coordinate_of(model, name.get<std::string>()));
    return coordinates;
}

std::map<int, PeriodPoints> points_by_period(const Json& list) {
    std::map<int, PeriodPoints> periods;
    for (const Json& cycle : list.at("cycles")) {
        if (cycle.contains("status") && cycle["status"] != "converged") continue;
        PeriodPoints& points = periods[cycle.at("period").get<int>()];
        ++points.orbits;
        for (const Json& point : cycle.at("points")) {
            points.x.push_back(point.at(0).get<double>());
            points.y.push_back(point.at(1).get<double>());
        }
    }
    return periods;
}

/// Sum of the squared distances between the points of two orbits of one period, point by point.
double squared_distance(const Json& cycle, const Json& orbit) {
    double distance = 0.0;
    for (std::size_t j = 0; j < cycle.at("points").size(); ++j) {
        for (std::size_t i = 0; i < cycle["points"][j].size(); ++i) {
            const double step = cycle["points"][j][i].get<double>() - orbit.at("points").at(j).at(i).get<double>();
            distance += step * step;
        }
    }
    return distance;
}

/// The computed orbit that each measured cycle became, -1 for none: nearest pairs first, so that cycles which took no
/// part in the estimate are left over.
std::vector<std::ptrdiff_t> matched_orbits(const Json& cycles, const Json& orbits) {
    struct Pair {
        double distance;
        std::size_t cycle;
        std::size_t orbit;
    };
    std::vector<Pair> pairs;
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        for (std::size_t o = 0; o < orbits.size(); ++o) {
            if (orbits[o].at("period") != cycles[c].at("period") || orbits[o].value("status", "") != "converged")
                continue;
            pairs.push_back({squared_distance(cycles[c], orbits[o]), c, o});
        }
    }
    std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.distance < b.distance; });
    std::vector<std::ptrdiff_t> found(cycles.size(), -1);
    std::vector<bool> taken(orbits.size(), false);
    for (const Pair& pair : pairs) {
        if (found[pair.cycle] >= 0 || taken[pair.orbit]) continue;
        found[pair.cycle] = static_cast<std::ptrdiff_t>(pair.orbit);
        taken[pair.orbit] = true;
    }
    return found;
}

/// ln of the modulus of the largest multiplier; nan when it is not known.
double growth(const Json& cycle) {
    const auto list = cycle.find("multipliers");
    if (list == cycle.end() || !list->is_array() || list->empty() || !list->front().at(0).is_number())
        return std::numeric_limits<double>::quiet_NaN();
    return std::log(std::hypot(list->front().at(0).get<double>(), list->front().at(1).get<double>()));
}

double growth_sd(const Json& cycle) {
    const auto covariance = cycle.find("ln_multiplier_covariance");
    if (covariance == cycle.end() || !covariance->is_array() || covariance->empty() ||
        !covariance->front().at(0).is_number())
        return std::numeric_limits<double>::quiet_NaN();
    return std::sqrt(covariance->front().at(0).get<double>());
}

/// A cycle in the plot of multipliers.
struct Growth {
    int period;
    double measured;
    double sd;
    double computed;
    [[nodiscard]] double order() const { return std::isfinite(computed) ? computed : measured; }
};

std::vector<Growth> growths(const StoredRun& run) {
    const double unknown = std::numeric_limits<double>::quiet_NaN();
    std::vector<Growth> list;
    const Json* computed = run.orbits_of_estimate();
    if (run.cycles) {
        const Json& measured = run.cycles->at("cycles");
        const auto matches = computed != nullptr ? matched_orbits(measured, computed->at("cycles"))
                                                 : std::vector<std::ptrdiff_t>(measured.size(), -1);
        for (std::size_t c = 0; c < measured.size(); ++c) {
            const Json& cycle = measured[c];
            const std::ptrdiff_t match = matches[c];
            Growth one{cycle.at("period").get<int>(), growth(cycle), growth_sd(cycle), unknown};
            if (match >= 0) one.computed = growth(computed->at("cycles")[static_cast<std::size_t>(match)]);
            list.push_back(one);
        }
    } else if (computed != nullptr) {
        for (const Json& cycle : computed->at("cycles"))
            if (cycle.value("status", std::string()) == "converged")
                list.push_back({cycle.at("period").get<int>(), unknown, unknown, growth(cycle)});
    }
    std::erase_if(list, [](const Growth& one) { return !std::isfinite(one.order()); });
    std::stable_sort(list.begin(), list.end(), [](const Growth& a, const Growth& b) {
        return a.period != b.period ? a.period < b.period : a.order() < b.order();
    });
    return list;
}

}  // namespace

bool has_multipliers(const StoredRun& run) {
    return !growths(run).empty();
}

std::string multipliers(const StoredRun& run, const PlotStyle& style) {
    const auto list = growths(run);
    Figure figure(style);
    figure.title(run.title());
    const double radius = 0.28 * figure.font();
    const PlotMarker open = series_marker(0, radius);
    const PlotMarker filled{"#0072b2", series_marker(0, 0.5 * radius).outline};
    std::vector<double> x;
    std::vector<double> measured;
    std::vector<double> computed;
    double lowest = std::numeric_limits<double>::infinity();
    double highest = 0.0;
    for (std::size_t first = 0; first < list.size();) {
        std::size_t end = first;
        while (end < list.size() && list[end].period == list[first].period)
            ++end;
        // Cycles of one period side by side, by size, within 0.8 of the distance to the next period.
        for (std::size_t k = first; k < end; ++k) {
            const auto share = (static_cast<double>(k - first) + 0.5) / static_cast<double>(end - first);
            x.push_back(list[k].period + 0.8 * (share - 0.5));
            measured.push_back(std::exp(list[k].measured));
            computed.push_back(std::exp(list[k].computed));
            for (const double value : {measured.back(), computed.back()}) {
                if (!std::isfinite(value)) continue;
                lowest = std::min(lowest, value);
                highest = std::max(highest, value);
            }
        }
        first = end;
    }
    const bool has_measured = run.cycles.has_value();
    const bool has_computed = std::any_of(computed.begin(), computed.end(), [](double v) { return std::isfinite(v); });
    std::vector<LegendEntry> legend;
    if (has_measured) legend.push_back({"measured, ± 2 sd", LegendEntry::Kind::marker, open, {}, true});
    if (has_computed) legend.push_back({"of the model", LegendEntry::Kind::marker, filled, {}});
    figure.legend(legend);
    PlotAxis x_axis;
    x_axis.lower = list.front().period - 0.55;
    x_axis.upper = list.back().period + 0.55;
    x_axis.label = "period";
    for (int period = list.front().period; period <= list.back().period; ++period)
        x_axis.ticks.push_back({static_cast<double>(period), std::to_string(period)});
    const auto ends = spared_logarithmically(lowest, highest);
    Panel panel(figure, figure.row(0.62 * figure.width()), x_axis,
                logarithmic_axis("|largest multiplier|", "", ends[0], ends[1]));
    panel.open();
    if (lowest < 1.0) panel.horizontal(1.0, {"#39424f", 0.6, "3 2"});
    for (std::size_t k = 0; k < list.size(); ++k) {
        if (!(list[k].sd > 0.0)) continue;
        const double at = panel.x(x[k]);
        figure.line(at, panel.y(std::exp(list[k].measured - 2.0 * list[k].sd)), at,
                    panel.y(std::exp(list[k].measured + 2.0 * list[k].sd)), {open.colour, 0.7});
    }
    panel.markers(x, measured, open, Panel::Filling::open);
    panel.markers(x, computed, filled);
    panel.frame();
    return figure.svg("Multipliers", fmt::format("largest multipliers of {} periodic orbits, from {:.3g} to {:.3g}",
                                                 list.size(), lowest, highest));
}

bool has_cycles(const StoredRun& run) {
    const Json* list = cycle_list(run);
    return list != nullptr && list->at("coordinates").size() >= 2 && !list->at("cycles").empty();
}

std::string cycles(const StoredRun& run, const PlotStyle& style) {
    const Json& list = *cycle_list(run);
    const auto coordinates = coordinates_of(run, list);
    const SectionPoints none{{coordinates.at(0), coordinates.at(1)}, {}, {}};
    return section_svg({none, points_by_period(list), run.title(), "Periodic points", ""}, style);
}

bool has_section(const StoredRun& run) {
    const auto experiments = run.experiments();
    if (experiments.empty()) return false;
    // Samples show a section only where the job says which.
    const bool cut = run.job.contains("orbits") && !run.job["orbits"].contains("file");
    for (const Json* experiment : experiments) {
        if (experiment->contains("simulate")) {
            const bool sections = (*experiment)["simulate"].contains("sections");
            for (const char* ending : {".h5", ".csv"}) {
                const std::string name = experiments.size() == 1 ? std::string("series")
                                                                 : "series_" + experiment->value("name", std::string());
                if ((sections || cut) && std::filesystem::exists(run.folder / (name + ending)) &&
                    (!run.cycles || run.cycles->at("coordinates").size() >= 2))
                    return true;
            }
        } else if (experiment->contains("file") && (experiment->value("kind", std::string()) == "section" || cut) &&
                   (!run.cycles || run.cycles->at("coordinates").size() >= 2)) {
            if (std::filesystem::exists(run.folder / (*experiment)["file"].get<std::string>())) return true;
        }
    }
    return false;
}

std::string section(const StoredRun& run, const PlotStyle& style) {
    auto points = section_points(run);
    if (!points)
        throw orbits::DataError(
            fmt::format("{}: the record has no section of two coordinates to plot", run.folder.string()));
    std::map<int, PeriodPoints> periods;
    if (run.cycles && run.cycles->at("coordinates").size() >= 2) periods = points_by_period(*run.cycles);
    return section_svg({std::move(*points), std::move(periods), run.title(), "Section", ""}, style);
}

}  // namespace orbid::apps::catalog
