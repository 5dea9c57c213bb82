#include <cmath>
#include <map>
#include <vector>

#include <fmt/format.h>

#include "apps/documents/json_value.hpp"
#include "apps/drawing/branch_plot.hpp"
#include "apps/drawing/section_plot.hpp"
#include "apps/report/plots/cycle_pairing.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "apps/stored_run/stored_section.hpp"
#include "models/system/stopped.hpp"

/// Charts of sections, their periodic points, and branches of these.
namespace orbid::apps {

namespace {

using namespace detail;
using periodic::OrbitMeasure;

bool is_left_out(const Json& cycle) {
    return cycle.contains("status") && cycle["status"] != "converged";
}

/// Points of cycles by period, in the first two coordinates.
std::map<int, PeriodPoints> points_by_period(const Json& cycles) {
    std::map<int, PeriodPoints> periods;
    for (std::size_t number = 0; number < cycles.size(); ++number) {
        const Json& cycle = cycles[number];
        if (is_left_out(cycle)) continue;
        PeriodPoints& out = periods[whole_number<int>(cycle.at("period"))];
        ++out.orbits;
        const Json& points = cycle.at("points");
        for (std::size_t j = 0; j < points.size(); ++j) {
            out.x.push_back(points.at(j).at(0).get<double>());
            out.y.push_back(points.at(j).at(1).get<double>());
            out.labels.push_back(fmt::format("cycle {}, point {} of {}, largest |multiplier| {:.4g}", number, j + 1,
                                             points.size(), largest_multiplier(cycle)));
        }
    }
    return periods;
}

/// Where the coordinates of measured cycles stand among those of computed orbits, which may have that of a plane too.
std::vector<std::size_t> shared_places(const StoredRun& run) {
    std::vector<std::size_t> places;
    const Json& computed = block_at(run.orbits_of_estimate(), "coordinates");
    for (const Json& name : block_at(run.cycles, "coordinates")) {
        const auto at = std::find(computed.begin(), computed.end(), name);
        if (at != computed.end()) places.push_back(static_cast<std::size_t>(at - computed.begin()));
    }
    return places;
}

/// Sum of the squared distances between the points of two orbits of one period, point by point.
double squared_distance(const Json& cycle, const Json& orbit, const std::vector<std::size_t>& places) {
    double distance = 0.0;
    for (std::size_t j = 0; j < cycle.at("points").size(); ++j) {
        for (std::size_t i = 0; i < places.size(); ++i) {
            const double step =
                cycle.at("points").at(j).at(i).get<double>() - orbit.at("points").at(j).at(places[i]).get<double>();
            distance += step * step;
        }
    }
    return distance;
}

/// The largest multiplier of a cycle, measured and of the model; nan where one is not known.
struct Growth {
    std::size_t number;
    double measured;
    double sd;  ///< of its logarithm
    double computed;

    [[nodiscard]] double size() const { return std::isfinite(measured) ? measured : computed; }
};

/// By period and size. Measured cycles meet the computed orbits that they became: nearest pairs first, so that cycles
/// which took no part in the estimate are left over.
std::map<int, std::vector<Growth>> growths(const StoredRun& run) {
    const Json& measured = block_at(run.cycles, "cycles");
    const Json& computed = block_at(run.orbits_of_estimate(), "cycles");
    std::map<int, std::vector<Growth>> periods;
    const auto add = [&periods](const Json& cycle, const Growth& growth) {
        if (growth.size() > 0.0) periods[whole_number<int>(cycle.at("period"))].push_back(growth);
    };
    const std::vector<std::size_t> places = shared_places(run);
    std::vector<Pairing> pairs;
    // Vectors of delays are no states.
    const bool comparable = measured.empty() || places.size() == run.cycles->at("coordinates").size();
    for (std::size_t o = 0; o < computed.size(); ++o) {
        if (is_left_out(computed[o])) continue;
        for (std::size_t c = 0; comparable && c < measured.size(); ++c)
            if (measured.at(c).at("period") == computed.at(o).at("period"))
                pairs.push_back({squared_distance(measured[c], computed[o], places), c, o});
        if (measured.empty()) add(computed[o], {o, std::nan(""), std::nan(""), largest_multiplier(computed[o])});
    }
    std::vector<double> of_model(measured.size(), std::nan(""));
    for (const Pairing& pair : nearest_pairs(std::move(pairs)))
        of_model[pair.first] = largest_multiplier(computed[pair.second]);
    for (std::size_t c = 0; c < measured.size(); ++c)
        add(measured[c], {c, largest_multiplier(measured[c]), largest_multiplier_sd(measured[c]), of_model[c]});
    for (auto& [period, list] : periods)
        std::stable_sort(list.begin(), list.end(),
                         [](const Growth& a, const Growth& b) { return a.size() < b.size(); });
    return periods;
}

/// Of a predicted branch: of frequency and half ranges, and of all else that was measured, sheet by sheet.
BranchBands predicted_bands(const StoredRun& run) {
    BranchBands bands;
    const Json& branch = block_at(run.prediction, "branch");
    const Json& points = block_at(branch, "points");
    int sheet = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
        const int own = whole_number<int>(points.at(k).at("sheet"));
        for (const auto& [name, band] : points.at(k).at("quantities").items()) {
            const bool shown =
                name == "frequency" || !block_at(run.prediction, "measured").empty() || name.ends_with(".half_range");
            if (!shown || name == "multiplier") continue;
            const double lower = interval_end(band, 0), upper = interval_end(band, 1);
            auto& list = bands[name];
            // A fold, or an orbit that too few draws have, ends a band.
            if (list.empty() || own != sheet || !std::isfinite(lower)) {
                if (list.empty() || !list.back().x.empty()) list.emplace_back();
            }
            if (!std::isfinite(lower)) continue;
            list.back().x.push_back(number_at(points.at(k), "parameter"));
            list.back().lower.push_back(lower);
            list.back().upper.push_back(upper);
        }
        sheet = own;
    }
    // An angle that turns around has none.
    std::erase_if(bands, [](const auto& one) { return one.second.size() == 1 && one.second.front().x.empty(); });
    return bands;
}

/// The coordinate and measure that a name like "h.half_range" or "frequency" says; nothing for others.
std::optional<std::pair<std::size_t, OrbitMeasure>> measure_named(const Json& coordinates, const std::string& name) {
    if (name == periodic::name_of(OrbitMeasure::frequency)) return std::pair{std::size_t{0}, OrbitMeasure::frequency};
    for (int m = 0; m < static_cast<int>(OrbitMeasure::frequency); ++m)
        for (std::size_t i = 0; i < coordinates.size(); ++i) {
            const auto measure = static_cast<OrbitMeasure>(m);
            if (name == coordinates.at(i).get<std::string>() + "." + periodic::name_of(measure))
                return std::pair{i, measure};
        }
    return std::nullopt;
}

}  // namespace

double largest_multiplier(const Json& cycle) {
    const Json& list = block_at(cycle, "multipliers");
    if (list.empty() || !list.front().is_array() || list.front().size() != 2) return std::nan("");
    const Json& first = list.front();
    return first[1].is_number() ? std::hypot(number_of(first[0]), number_of(first[1])) : std::nan("");
}

double largest_multiplier_sd(const Json& cycle) {
    const Json& variances = block_at(cycle, "ln_multiplier_covariance");
    return variances.empty() ? std::nan("") : std::sqrt(number_of(variances[0][0]));
}

Chart section_chart(const StoredRun& run) {
    auto points = section_points(run);
    if (!points) return {"section"};
    SectionPicture picture{std::move(*points), {}, "The section of the record and its periodic points by period", ""};
    const Json& cycles = block_at(run.cycles, "cycles");
    if (!cycles.empty() && run.cycles->at("coordinates").size() >= 2) picture.periods = points_by_period(cycles);
    models::stop_if_asked(run.interrupted);
    return section_chart(picture);
}

Chart cycle_chart(const StoredRun& run) {
    const Json* list = run.cycles ? &*run.cycles : run.orbits ? &*run.orbits : nullptr;
    const Json& cycles = block_at(list, "cycles");
    if (cycles.empty() || list->at("coordinates").size() < 2) return {"cycles"};
    const ModelJob model = stored_model(run);
    SectionPicture picture;
    for (std::size_t i = 0; i < 2; ++i)
        picture.section.coordinates[i] =
            catalog::coordinate_of(model, list->at("coordinates").at(i).get<std::string>());
    picture.periods = points_by_period(cycles);
    picture.title = "Periodic points by period";
    picture.description = fmt::format("points of {} periodic orbits, by period", cycles.size());
    Chart chart = section_chart(picture);
    chart.name = "cycles";
    return chart;
}

Chart multiplier_chart(const StoredRun& run) {
    const auto periods = growths(run);
    Chart chart{"multipliers", "Largest multiplier of each cycle by period"};
    if (periods.empty()) return chart;
    ChartView view;
    ChartRange range;
    std::size_t count = 0;
    ChartLayer errors{LayerKind::intervals, "± 2 sd", 1, Ink::soft};
    ChartLayer model{LayerKind::points, "of the model", 6, Ink::ink};
    model.open = true;
    // Long periods first, as in sections.
    for (auto entry = periods.rbegin(); entry != periods.rend(); ++entry) {
        const auto& [period, list] = *entry;
        ChartLayer layer{LayerKind::points, fmt::format("period {}", period), std::clamp(period, 1, 8)};
        for (std::size_t k = 0; k < list.size(); ++k) {
            const Growth& growth = list[k];
            // Within 0.8 of the way to the next period.
            const double at = period + 0.8 * ((static_cast<double>(k) + 0.5) / static_cast<double>(list.size()) - 0.5);
            range.include(growth.measured);
            range.include(growth.computed);
            if (growth.sd > 0.0) {
                errors.x.push_back(at);
                errors.lower.push_back(growth.measured * std::exp(-2.0 * growth.sd));
                errors.upper.push_back(growth.measured * std::exp(2.0 * growth.sd));
            }
            if (growth.computed > 0.0) {
                model.add(at, growth.computed);
                model.labels.push_back(fmt::format("cycle {} of the model", growth.number));
            }
            if (!std::isfinite(growth.measured)) continue;
            layer.add(at, growth.measured);
            layer.labels.push_back(fmt::format("cycle {}", growth.number));
        }
        count += list.size();
        view.add(std::move(layer));
    }
    view.add(std::move(errors));
    view.add(std::move(model));
    if (range.lowest < 1.0) view.layers.push_back(level_rule(1.0, "", Ink::soft, true));
    view.x = {"period, cycles by size", "", periods.begin()->first - 0.6, periods.rbegin()->first + 0.6};
    view.x.whole = true;
    view.y = range.axis("largest |multiplier|", "", true);
    view.height = 0.45;
    chart.add(std::move(view));
    chart.description = fmt::format("largest multipliers of {} periodic orbits, from {:.3g} to {:.3g}", count,
                                    range.lowest, range.highest);
    return chart;
}

Chart branch_chart(const StoredRun& run) {
    Chart chart{"branch", "Branches of periodic orbits over the parameter", "Coordinate"};
    const Json* own = run.shown_branch();
    if (block_at(own, "branches").empty()) return chart;
    const Json& file = *own;
    const auto stored = stored_branches(file.dump());
    if (!stored) return chart;
    BranchPicture picture;
    picture.parameter = {text_at(file.at("parameter"), "name"), text_at(file.at("parameter"), "unit"), false};
    const ModelJob model = stored_model(run);
    const BranchBands bands = predicted_bands(run);
    if (!stored->followed.measured.empty() || !bands.empty())
        return measure_chart(stored->followed, picture.parameter, series_coordinates(*model.system), bands);
    const auto add_view = [&] {
        Chart one = branch_chart(stored->followed.branches, picture);
        chart.views.push_back(std::move(one.views.front()));
        chart.description = one.description;
    };
    const Json& coordinates = file.at("coordinates");
    const auto add_view_of_time = [&] {
        picture.shown.reset();
        picture.coordinate = BranchPicture{}.coordinate;
        add_view();
    };
    const auto add_coordinate = [&](std::size_t i) {
        picture.shown = static_cast<Eigen::Index>(i);
        picture.coordinate = catalog::coordinate_of(model, coordinates.at(i).get<std::string>());
        add_view();
    };
    const auto add_measure = [&](std::size_t i, OrbitMeasure measure) {
        picture.shown = static_cast<Eigen::Index>(i);
        picture.coordinate = catalog::coordinate_of(model, coordinates.at(i).get<std::string>());
        show_measure(measure, picture);
        add_view();
        picture.measure.reset();
    };
    // What the job plots comes first: a coordinate or measure, or else the time.
    const Json::json_pointer place("/periodic/continuation/plot");
    const std::string plotted = run.job.contains(place) ? run.job.at(place).get<std::string>() : std::string();
    const auto first =
        static_cast<std::size_t>(std::find(coordinates.begin(), coordinates.end(), plotted) - coordinates.begin());
    const auto asked = measure_named(coordinates, plotted);
    if (asked) add_measure(asked->first, asked->second);
    if (first < coordinates.size())
        add_coordinate(first);
    else
        add_view_of_time();
    for (std::size_t i = 0; i < coordinates.size(); ++i)
        if (i != first) add_coordinate(i);
    for (std::size_t i = 0; i < coordinates.size(); ++i)
        if (asked != std::pair{i, OrbitMeasure::half_range}) add_measure(i, OrbitMeasure::half_range);
    if (!asked || asked->second != OrbitMeasure::frequency) add_measure(0, OrbitMeasure::frequency);
    return chart;
}

}  // namespace orbid::apps
