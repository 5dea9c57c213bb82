#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include <boost/math/distributions/normal.hpp>

#include "apps/drawing/figure.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "orbits/records/data_error.hpp"

/// Record by record: residuals and their distribution.
namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

/// What a record was compared with.
enum class Source { cycle, series };

/// Records of one coordinate, from one kind of source.
struct Group {
    Source source;
    std::string coordinate;
    std::vector<const ResidualRow*> rows;
};

std::vector<Group> groups_of(const std::vector<ResidualRow>& rows) {
    std::vector<Group> groups;
    for (const ResidualRow& row : rows) {
        const Source source = is_cycle(row) ? Source::cycle : Source::series;
        auto found = std::find_if(groups.begin(), groups.end(), [&](const Group& group) {
            return group.source == source && group.coordinate == row.coordinate;
        });
        if (found == groups.end()) found = groups.insert(groups.end(), Group{source, row.coordinate, {}});
        found->rows.push_back(&row);
    }
    return groups;
}

/// (observed - predicted) / sd; nan when one is not known.
double normalised(const ResidualRow& row) {
    return row.sd > 0.0 ? (row.observed - row.predicted) / row.sd : std::numeric_limits<double>::quiet_NaN();
}

std::string place_label(const StoredRun& run, const Group& group, const ModelJob& model, std::string& unit) {
    if (group.source == Source::cycle) return "record, cycle by cycle";
    if (is_sampled(run, group.rows.front()->experiment)) {
        unit = time_unit(model);
        return "t";
    }
    return "record";
}

std::string group_name(const Group& group, bool both) {
    const std::string name = display_name(group.coordinate);
    return both ? name + (group.source == Source::cycle ? ", cycles" : ", series") : name;
}

bool has_both(const std::vector<Group>& groups) {
    return std::any_of(groups.begin(), groups.end(), [](const Group& g) { return g.source == Source::cycle; }) &&
           std::any_of(groups.begin(), groups.end(), [](const Group& g) { return g.source == Source::series; });
}

}  // namespace

bool has_residuals(const StoredRun& run) {
    std::error_code missing;
    // A header alone has fewer bytes.
    constexpr std::uintmax_t header = 90;
    const auto bytes = std::filesystem::file_size(run.folder / "residuals.csv", missing);
    return !missing && bytes > header;
}

std::string residuals(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const auto groups = groups_of(rows);
    const bool both = has_both(groups);
    const ModelJob model = stored_model(run);
    Figure figure(style);
    figure.title(run.title());
    double reach = 3.0;
    std::size_t outside = 0;
    std::size_t known = 0;
    for (const ResidualRow& row : rows) {
        const double z = normalised(row);
        if (!std::isfinite(z)) continue;
        ++known;
        if (std::abs(z) > 2.0) ++outside;
        reach = std::max(reach, std::abs(z));
    }
    const double range = std::min(1.08 * reach, 12.0);
    const PlotAxis y = linear_axis("residual / sd", "", -range, range, 4);
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const Group& group = groups[g];
        std::string unit;
        const std::string label = place_label(run, group, model, unit);
        std::string unit_below;
        const bool last = g + 1 == groups.size() || place_label(run, groups[g + 1], model, unit_below) != label;
        const bool timed = label == "t";
        // By experiment and segment, so that those of several have different colours.
        std::map<std::string, std::array<std::vector<double>, 2>> parts;
        std::vector<std::string> order;
        std::array<double, 2> ends{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
        const std::size_t every = stride(group.rows.size(), 4000);
        for (std::size_t k = 0; k < group.rows.size(); ++k) {
            const ResidualRow& row = *group.rows[k];
            const double at = timed ? row.at : static_cast<double>(k + 1);
            ends = {std::min(ends[0], at), std::max(ends[1], at)};
            const double z = normalised(row);
            // Thinned, but never of what stands out.
            if (k % every != 0 && !(std::abs(z) > 3.0)) continue;
            const std::string part = group.source == Source::cycle ? std::string() : row.experiment + " " + row.block;
            if (!parts.contains(part)) order.push_back(part);
            parts[part][0].push_back(at);
            parts[part][1].push_back(std::clamp(z, -range, range));
        }
        const double spare = 0.015 * (ends[1] - ends[0]);
        Panel panel(
            figure,
            figure.row(std::max(0.27 * figure.width(), 9.0 * figure.font()) + (last ? 1.4 * figure.font() : 0.0)),
            linear_axis(last ? label : std::string(), last ? unit : std::string(), ends[0] - spare, ends[1] + spare),
            y);
        panel.open();
        figure.rectangle({panel.box().left, panel.y(2.0), panel.box().right, panel.y(-2.0)}, "#eef1f5");
        panel.horizontal(0.0, {"#39424f", 0.6});
        constexpr std::array<std::string_view, 4> colours{"#0072b2", "#e69f00", "#009e73", "#8c510a"};
        // Few records as dots that are seen, many as dots that do not cover each other.
        const std::size_t shown = group.rows.size() / every;
        const double diameter = shown < 100 ? 2.6 : shown < 1000 ? 1.7 : 1.1;
        for (std::size_t p = 0; p < order.size(); ++p) {
            const auto& part = parts[order[p]];
            panel.dots(part[0], part[1], colours[p % colours.size()], diameter, 0.8);
        }
        panel.frame();
        if (groups.size() > 1) panel.tag(group_name(group, both));
    }
    return figure.svg("Residuals",
                      fmt::format("{} residuals over their sd, {} of them ({:.1f} %) beyond 2", known, outside,
                                  known > 0 ? 100.0 * static_cast<double>(outside) / static_cast<double>(known) : 0.0));
}

std::string normal_quantiles(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const auto groups = groups_of(rows);
    const bool both = has_both(groups);
    Figure figure(style);
    figure.title(run.title());
    std::vector<LegendEntry> legend;
    std::vector<std::vector<double>> sorted;
    double reach = 3.0;
    for (const Group& group : groups) {
        std::vector<double> values;
        for (const ResidualRow* row : group.rows)
            if (const double z = normalised(*row); std::isfinite(z)) values.push_back(z);
        std::sort(values.begin(), values.end());
        if (!values.empty()) reach = std::max({reach, -values.front(), values.back()});
        legend.push_back({group_name(group, both),
                          LegendEntry::Kind::marker,
                          series_marker(sorted.size(), 0.2 * figure.font()),
                          {}});
        sorted.push_back(std::move(values));
    }
    figure.legend(legend);
    const boost::math::normal standard;
    double widest = 2.5;
    for (const auto& values : sorted) {
        if (values.size() > 1) {
            const double last = 1.0 - 0.5 / static_cast<double>(values.size());
            widest = std::max(widest, 1.08 * boost::math::quantile(standard, last));
        }
    }
    const double range = std::min(1.08 * reach, 12.0);
    Panel panel(figure, figure.row(0.8 * figure.width()), linear_axis("normal quantile", "", -widest, widest, 7),
                linear_axis("residual / sd", "", -range, range, 7));
    panel.open();
    panel.curve(std::array{-20.0, 20.0}, std::array{-20.0, 20.0}, {"#39424f", 0.6});
    for (std::size_t g = 0; g < sorted.size(); ++g) {
        const auto count = static_cast<double>(sorted[g].size());
        std::vector<double> x;
        std::vector<double> y;
        double last = -std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < sorted[g].size(); ++k) {
            // Plotting positions of Hazen; markers nearer than 0.02 cover each other.
            const double quantile = boost::math::quantile(standard, (static_cast<double>(k) + 0.5) / count);
            if (quantile - last < 0.02) continue;
            last = quantile;
            x.push_back(quantile);
            y.push_back(std::clamp(sorted[g][k], -range, range));
        }
        panel.markers(x, y, series_marker(g, 0.16 * figure.font()), Panel::Filling::plain);
    }
    panel.frame();
    return figure.svg("Normal quantiles", "residuals over their sd against quantiles of the normal distribution");
}

}  // namespace orbid::apps::catalog
