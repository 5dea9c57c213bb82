#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "apps/drawing/figure.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/report/plots/marginal_density.hpp"
#include "apps/results/summary_table.hpp"
#include "orbits/records/data_error.hpp"

/// What is known of each parameter beyond its sd: profiles, marginal densities, draws from the posterior.
namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;
constexpr Stroke normal_line{"#d55e00", 0.8, "2.4 1.6"};

/// Places of `count` equal panels, as many beside each other as are wide enough.
std::vector<PageBox> tiles(Figure& figure, std::size_t count, double shape) {
    // A panel needs room for three numbers below and a label.
    const double least = 15.0 * figure.font();
    const auto columns = std::clamp<std::size_t>(static_cast<std::size_t>(figure.width() / least), 1, count);
    const double width = figure.width() / static_cast<double>(columns);
    std::vector<PageBox> boxes;
    PageBox row;
    for (std::size_t k = 0; k < count; ++k) {
        if (k % columns == 0) row = figure.row(shape * width);
        const double left = width * static_cast<double>(k % columns);
        boxes.push_back({left, row.top, left + width, row.bottom});
    }
    return boxes;
}

/// The entry of an estimated parameter or derived quantity; null when there is none.
const Json* quantity(const Json& result, const std::string& name) {
    for (const char* block : {"parameters", "derived"})
        if (result.contains(block) && result[block].contains(name)) return &result[block][name];
    return nullptr;
}

/// Entries of a block that are known, by name.
std::vector<std::pair<std::string, const Json*>> known_entries(const StoredRun& run, const char* block) {
    std::vector<std::pair<std::string, const Json*>> list;
    if (!run.result || !run.result->contains(block) || !(*run.result)[block].is_object()) return list;
    for (const auto& [name, entry] : (*run.result)[block].items())
        if (entry.is_object() && entry.value("known", false) && entry.contains("points") && entry["points"].size() > 2)
            list.emplace_back(name, &entry);
    return list;
}

std::vector<double> values_of(const Json& points, const char* key) {
    std::vector<double> list;
    for (const Json& point : points)
        list.push_back(number(point, key));
    return list;
}

std::array<double, 2> range_of(const std::vector<double>& values) {
    std::array<double, 2> range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    for (const double value : values)
        if (std::isfinite(value)) range = {std::min(range[0], value), std::max(range[1], value)};
    return range;
}

PlotAxis value_axis(const std::string& name, const std::string& unit, double lowest, double highest) {
    return linear_axis(quantity_name(name), unit, lowest, highest, 3);
}

/// Normal density around the estimate, at the given places.
std::vector<double> normal_density(const std::vector<double>& at, double mean, double sd) {
    std::vector<double> density;
    for (const double value : at) {
        const double z = (value - mean) / sd;
        density.push_back(std::exp(-0.5 * z * z) / (sd * std::sqrt(2.0 * std::numbers::pi)));
    }
    return density;
}

/// Places from one end to the other, for smooth curves.
std::vector<double> evenly(double lowest, double highest) {
    constexpr int count = 121;
    std::vector<double> places;
    for (int k = 0; k < count; ++k)
        places.push_back(lowest + (highest - lowest) * k / (count - 1));
    return places;
}

/// Bars of a histogram: ends and heights as a density.
struct Histogram {
    std::vector<double> ends;
    std::vector<double> heights;
};

Histogram histogram(std::vector<double> draws) {
    Histogram bars;
    std::erase_if(draws, [](double value) { return !std::isfinite(value); });
    std::sort(draws.begin(), draws.end());
    if (draws.size() < 2 || !(draws.back() > draws.front())) return bars;
    const auto count = static_cast<double>(draws.size());
    // Width by Freedman and Diaconis (1981), with 8 to 60 bars whatever the tails.
    const double quartiles = draws[draws.size() * 3 / 4] - draws[draws.size() / 4];
    const double span = draws.back() - draws.front();
    const double width = quartiles > 0.0 ? 2.0 * quartiles / std::cbrt(count) : span;
    const auto bins = static_cast<std::size_t>(std::clamp(std::ceil(span / width), 8.0, 60.0));
    std::vector<std::size_t> counts(bins, 0);
    for (const double value : draws) {
        const auto bin = static_cast<std::size_t>((value - draws.front()) / span * static_cast<double>(bins));
        ++counts[std::min(bin, bins - 1)];
    }
    const double step = span / static_cast<double>(bins);
    for (std::size_t b = 0; b <= bins; ++b)
        bars.ends.push_back(draws.front() + step * static_cast<double>(b));
    for (const std::size_t one : counts)
        bars.heights.push_back(static_cast<double>(one) / (count * step));
    return bars;
}

void draw_bars(Panel& panel, const Histogram& bars) {
    for (std::size_t b = 0; b < bars.heights.size(); ++b)
        panel.figure().rectangle(
            {panel.x(bars.ends[b]), panel.y(bars.heights[b]), panel.x(bars.ends[b + 1]), panel.y(0.0)}, "#cdd9e5",
            {"#ffffff", 0.25});
}

/// Density axis without numbers: its unit says nothing to the eye.
PlotAxis density_axis(double highest) {
    PlotAxis axis;
    axis.lower = 0.0;
    axis.upper = 1.08 * (highest > 0.0 ? highest : 1.0);
    return axis;
}

}  // namespace

bool has_profiles(const StoredRun& run) {
    return !known_entries(run, "profile").empty();
}

std::string profiles(const StoredRun& run, const PlotStyle& style) {
    const auto list = known_entries(run, "profile");
    Figure figure(style);
    figure.title(run.title());
    figure.legend({{"profile", LegendEntry::Kind::line, {}, {blue, 1.2}},
                   {"normal", LegendEntry::Kind::line, {}, normal_line},
                   {"95 %", LegendEntry::Kind::line, {}, {"#39424f", 0.6}}});
    const auto boxes = tiles(figure, list.size(), 0.8);
    std::string description;
    for (std::size_t k = 0; k < list.size(); ++k) {
        const Json& entry = *list[k].second;
        const auto values = values_of(entry["points"], "value");
        std::vector<double> rise;
        for (const double root : values_of(entry["points"], "signed_root"))
            rise.push_back(root * root);
        const double threshold = number(entry, "threshold");
        const auto [lowest, highest] = range_of(values);
        PlotAxis y = linear_axis("twice the rise", "", 0.0, 1.6 * threshold, 4);
        Panel panel(figure, boxes[k], value_axis(list[k].first, entry.value("unit", std::string()), lowest, highest),
                    y);
        panel.open();
        panel.horizontal(threshold, {"#39424f", 0.6});
        if (const Json* estimate = quantity(*run.result, list[k].first)) {
            const auto places = evenly(lowest, highest);
            std::vector<double> parabola;
            for (const double at : places)
                parabola.push_back(std::pow((at - number(*estimate, "value")) / number(*estimate, "sd"), 2));
            panel.curve(places, parabola, normal_line);
        }
        panel.curve(values, rise, {blue, 1.2});
        panel.markers(values, rise, {blue, series_marker(0, 0.17 * figure.font()).outline});
        panel.frame();
        description += fmt::format("{}{}: 95 % from {} to {}", k == 0 ? "" : "; ", list[k].first,
                                   entry["interval95"][0].dump(), entry["interval95"][1].dump());
    }
    return figure.svg("Profiles", description);
}

bool has_marginals(const StoredRun& run) {
    return !known_entries(run, "marginals").empty();
}

std::string marginals(const StoredRun& run, const PlotStyle& style) {
    const auto list = known_entries(run, "marginals");
    const auto draws = stored_draws(run);
    Figure figure(style);
    figure.title(run.title());
    std::vector<LegendEntry> legend{{"marginal", LegendEntry::Kind::line, {}, {blue, 1.2}},
                                    {"normal", LegendEntry::Kind::line, {}, normal_line}};
    if (draws) legend.push_back({"draws", LegendEntry::Kind::bar, {}, {"#cdd9e5"}});
    figure.legend(legend);
    const auto boxes = tiles(figure, list.size(), 0.72);
    std::string description;
    for (std::size_t k = 0; k < list.size(); ++k) {
        const auto& [name, entry] = list[k];
        const MarginalDensity curve = marginal_density((*entry)["points"]);
        const auto& values = curve.x;
        const auto& density = curve.y;
        const double mean = number(*entry, "mean");
        const double sd = number(*entry, "sd");
        const auto ends = range_of(values);
        // Beyond four sds there is nothing to see.
        const double lowest = std::max(ends[0], mean - 4.0 * sd);
        const double highest = std::min(ends[1], mean + 4.0 * sd);
        Histogram bars;
        if (draws) {
            const auto column = std::find(draws->names.begin(), draws->names.end(), name);
            if (column != draws->names.end())
                bars = histogram(draws->columns[static_cast<std::size_t>(column - draws->names.begin())]);
        }
        double peak = range_of(density)[1];
        for (const double height : bars.heights)
            peak = std::max(peak, height);
        Panel panel(figure, boxes[k], value_axis(name, entry->value("unit", std::string()), lowest, highest),
                    density_axis(peak), {true, false, true, 0.8 * figure.font()});
        panel.open();
        draw_bars(panel, bars);
        if (const Json* estimate = quantity(*run.result, name)) {
            const auto places = evenly(lowest, highest);
            panel.curve(places, normal_density(places, number(*estimate, "value"), number(*estimate, "sd")),
                        normal_line);
        }
        panel.curve(values, density, {blue, 1.2});
        panel.frame();
        description +=
            fmt::format("{}{}: mean {}, sd {}", k == 0 ? "" : "; ", name, significant(mean, 6), significant(sd, 3));
    }
    return figure.svg("Marginal densities", description);
}

bool has_posterior(const StoredRun& run) {
    return run.result && std::filesystem::exists(run.folder / "posterior.csv");
}

std::string posterior(const StoredRun& run, const PlotStyle& style) {
    const auto draws = stored_draws(run);
    if (!draws || draws->chain.empty())
        throw orbits::DataError((run.folder / "posterior.csv").string() + ": holds no draws");
    // Pairs of the parameters; error scales and what does not fit on a page are left out.
    constexpr std::size_t most = 6;
    std::vector<std::size_t> shown;
    for (std::size_t c = 0; c < draws->names.size() && shown.size() < most; ++c)
        if (quantity(*run.result, draws->names[c]) != nullptr) shown.push_back(c);
    if (shown.empty()) shown.push_back(0);
    Figure figure(style);
    figure.title(run.title());
    const double left_room = 3.4 * figure.font();
    const double below = 3.0 * figure.font();
    const double gap = 0.45 * figure.font();
    const auto count = static_cast<double>(shown.size());
    const double side = (figure.width() - left_room - 0.8 * figure.font()) / count;
    const PageBox page = figure.row(side * count + below);
    std::vector<PlotAxis> axes;
    std::vector<Histogram> bars;
    for (const std::size_t c : shown) {
        const Json* entry = quantity(*run.result, draws->names[c]);
        std::vector<double> sorted = draws->columns[c];
        std::sort(sorted.begin(), sorted.end());
        // The outermost draws of a thousand would leave the rest in a corner.
        const std::size_t cut = sorted.size() / 500;
        const double span = sorted[sorted.size() - 1 - cut] - sorted[cut];
        axes.push_back(linear_axis(quantity_name(draws->names[c]),
                                   entry != nullptr ? entry->value("unit", std::string()) : std::string(),
                                   sorted[cut] - 0.05 * span, sorted[sorted.size() - 1 - cut] + 0.05 * span, 2));
        bars.push_back(histogram(draws->columns[c]));
    }
    // Without its unit where a label is wider than its cell.
    const auto fitting = [&](const std::string& label, std::size_t k) {
        return figure.width_of(label, 0.85) < side ? label : quantity_name(draws->names[shown[k]]);
    };
    constexpr std::size_t most_dots = 700;  // of a cell: more only cover each other
    const std::size_t every = std::max<std::size_t>(1, draws->chain.size() / most_dots);
    for (std::size_t i = 0; i < shown.size(); ++i) {
        for (std::size_t j = 0; j <= i; ++j) {
            const double left = page.left + left_room + side * static_cast<double>(j);
            const double top = page.top + side * static_cast<double>(i);
            const PageBox cell{left, top, left + side - gap, top + side - gap};
            const PlotAxis& x = axes[j];
            const auto px = [&](double value) { return x.at(value, cell.left, cell.right); };
            const double height = i == j ? density_axis(range_of(bars[i].heights)[1]).upper : 0.0;
            const auto py = [&](double value) {
                return i == j ? cell.bottom - (cell.bottom - cell.top) * value / height
                              : axes[i].at(value, cell.bottom, cell.top);
            };
            figure.element(
                "<svg x=\"{0:.2f}\" y=\"{1:.2f}\" width=\"{2:.2f}\" height=\"{3:.2f}\" viewBox=\"{0:.2f} {1:.2f} "
                "{2:.2f} {3:.2f}\" overflow=\"hidden\">\n",
                cell.left, cell.top, cell.width(), cell.height());
            if (i == j) {
                for (std::size_t b = 0; b < bars[i].heights.size(); ++b)
                    figure.rectangle({px(bars[i].ends[b]), py(bars[i].heights[b]), px(bars[i].ends[b + 1]), py(0.0)},
                                     "#9fb9d3", {"#ffffff", 0.2});
            } else {
                std::string path;
                for (std::size_t k = 0; k < draws->chain.size(); k += every)
                    path += fmt::format("M{:.2f} {:.2f}h0", px(draws->columns[shown[j]][k]),
                                        py(draws->columns[shown[i]][k]));
                figure.element(
                    "<path fill=\"none\" stroke=\"{}\" stroke-width=\"0.9\" stroke-opacity=\"0.45\" "
                    "stroke-linecap=\"round\" d=\"{}\"/>\n",
                    blue, path);
            }
            figure.raw("</svg>\n");
            figure.rectangle(cell, "none", {"#39424f", 0.5});
            if (i + 1 == shown.size()) {
                for (const Tick& tick : x.ticks) {
                    figure.line(px(tick.value), cell.bottom, px(tick.value), cell.bottom + 0.3 * figure.font(),
                                {"#39424f", 0.5});
                    figure.text(px(tick.value), cell.bottom + 1.1 * figure.font(), tick.label, {"middle", 0.8});
                }
                figure.text(0.5 * (cell.left + cell.right), cell.bottom + 2.3 * figure.font(), fitting(x.label, j),
                            {"middle", 0.85});
            }
            if (j == 0 && i > 0) {
                for (const Tick& tick : axes[i].ticks) {
                    figure.line(cell.left - 0.3 * figure.font(), py(tick.value), cell.left, py(tick.value),
                                {"#39424f", 0.5});
                    figure.text(cell.left - 0.4 * figure.font(), py(tick.value) + 0.3 * figure.font(), tick.label,
                                {"end", 0.8});
                }
                figure.text(page.left + 0.9 * figure.font(), 0.5 * (cell.top + cell.bottom), fitting(axes[i].label, i),
                            {"middle", 0.85, "#1d2430", false});
            }
        }
    }
    return figure.svg("Posterior",
                      fmt::format("{} draws of {} quantities, in pairs", draws->chain.size(), shown.size()));
}

}  // namespace orbid::apps::catalog
