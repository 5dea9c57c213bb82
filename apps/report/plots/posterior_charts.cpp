#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <fmt/format.h>

#include "apps/report/plots/run_charts.hpp"
#include "estimator/exploration/log_density_spline.hpp"

/// Charts of what is known of each parameter beyond its sd: profiles, marginal densities, draws from the posterior.
namespace orbid::apps {

namespace {

using namespace detail;

/// The entry of an estimated parameter or derived quantity; an empty one when there is none.
const Json& estimated_entry(const Json& result, const std::string& name) {
    const Json& found = block_at(block_at(result, "parameters"), name);
    return found.empty() ? block_at(block_at(result, "derived"), name) : found;
}

void add_reference(const Json& entry, ChartView& view) {
    const double reference = number_at(entry, "reference");
    if (std::isfinite(reference)) view.layers.push_back(upright_rule(reference, "reference", Ink::ink));
}

/// No layers for fewer than two points.
ChartView profile_view(const Json& result, const std::string& name, const Json& profile) {
    ChartView view;
    ChartLayer curve{LayerKind::line, "profile", 1};
    ChartRange x;
    ChartRange y;
    y.include(-2.5);
    y.include(2.5);
    for (const Json& point : block_at(profile, "points")) {
        const double root = number_at(point, "signed_root");
        if (!std::isfinite(root)) continue;
        curve.add(number_at(point, "value"), root);
        x.include(curve.x.back());
        y.include(root);
    }
    if (curve.x.size() < 2) return view;
    view.label = name;
    view.x = x.axis(display_name(name), text_at(profile, "unit"));
    view.y = y.axis("signed root", "");
    view.height = 0.45;
    const double sd = number_at(block_at(block_at(result, "parameters"), name), "sd");
    const double best = number_at(profile, "value");
    if (sd > 0.0) {
        ChartLayer normal{LayerKind::line, "normal approximation", 2};
        normal.dash = true;
        for (const double end : {view.x.lower, view.x.upper})
            normal.add(end, (end - best) / sd);
        view.layers.push_back(std::move(normal));
    }
    // The threshold is one of twice the objective's loss, of which the root is drawn.
    if (const double threshold = number_at(profile, "threshold"); threshold > 0.0) {
        for (const double side : {-1.0, 1.0})
            view.layers.push_back(level_rule(side * std::sqrt(threshold), "95 % limits", Ink::soft, true));
    }
    add_reference(estimated_entry(result, name), view);
    ChartLayer dots = curve;
    dots.kind = LayerKind::points;
    view.layers.push_back(std::move(curve));
    view.layers.push_back(std::move(dots));
    return view;
}

/// The density of a value from points of the density of the coordinate u in which it was followed (the logarithm of a
/// positive parameter): p(value) = p(u) du / dvalue, by a cubic spline of ln p(u) and cubic pieces of value(u), eight
/// places per interval; nothing for fewer than three points.
/// @param list  "points" of an entry of "marginals" in result.json.
ChartLayer laplace_density(const Json& list) {
    std::vector<std::array<double, 3>> points;
    for (const Json& point : list) {
        const std::array<double, 3> one{number_at(point, "coordinate"), number_at(point, "value"),
                                        number_at(point, "log_density")};
        if (std::isfinite(one[0]) && std::isfinite(one[1]) && std::isfinite(one[2])) points.push_back(one);
    }
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end(), [](const auto& a, const auto& b) { return a[0] == b[0]; }),
                 points.end());
    ChartLayer curve{LayerKind::line, "nested Laplace", 1};
    if (points.size() < 3) return curve;
    std::vector<double> u;
    std::vector<double> logs;
    for (const auto& point : points) {
        u.push_back(point[0]);
        logs.push_back(point[2]);
    }
    const estimator::LogDensitySpline spline(u, logs);
    const auto slope = [&](std::size_t k) {
        const std::size_t before = k > 0 ? k - 1 : k;
        const std::size_t after = std::min(k + 1, points.size() - 1);
        return (points[after][1] - points[before][1]) / (u[after] - u[before]);
    };
    constexpr int pieces = 8;
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
        const double step = u[k + 1] - u[k];
        for (int piece = 0; piece < pieces; ++piece) {
            const double t = static_cast<double>(piece) / pieces;
            // Hermite's cubic and its derivative.
            const double rise = points[k + 1][1] - points[k][1];
            const double first = slope(k) * step;
            const double last = slope(k + 1) * step;
            const double bend = 3.0 * rise - 2.0 * first - last;
            const double twist = first + last - 2.0 * rise;
            const double derivative = (first + t * (2.0 * bend + 3.0 * t * twist)) / step;
            curve.add(points[k][1] + t * (first + t * (bend + t * twist)),
                      std::exp(spline.log_density(u[k] + t * step)) / std::abs(derivative));
        }
    }
    return curve;
}

/// Draws as columns of a density; none where all are equal.
ChartLayer draw_columns(const std::vector<double>& values) {
    ChartLayer bars{LayerKind::bars, "draws", 2};
    const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
    if (values.empty() || !(*greatest > *least)) return bars;
    // Sturges' rule doubled: thousands of draws carry finer columns than its normal ones.
    const auto columns = static_cast<std::size_t>(2.0 * (1.0 + std::log2(static_cast<double>(values.size()))));
    const double width = (*greatest - *least) / static_cast<double>(columns);
    bars.y.assign(columns, 0.0);
    for (const double value : values)
        bars.y[std::min(columns - 1, static_cast<std::size_t>((value - *least) / width))] += 1.0;
    for (std::size_t k = 0; k <= columns; ++k)
        bars.x.push_back(*least + width * static_cast<double>(k));
    for (double& height : bars.y)
        height /= static_cast<double>(values.size()) * width;
    return bars;
}

/// The normal density around the estimate.
ChartLayer normal_density(const Json& entry, const ChartRange& x) {
    constexpr int places = 121;
    ChartLayer line{LayerKind::line, "normal approximation", 8};
    line.dash = true;
    const double mean = number_at(entry, "value");
    const double sd = number_at(entry, "sd");
    if (!(sd > 0.0)) return line;
    for (int k = 0; k < places; ++k) {
        const double at = x.lowest + (x.highest - x.lowest) * k / (places - 1);
        const double z = (at - mean) / sd;
        line.add(at, std::exp(-0.5 * z * z) / (sd * std::sqrt(2.0 * std::numbers::pi)));
    }
    return line;
}

/// No layers where there are neither draws nor a density.
ChartView marginal_view(const Json& result, const std::string& name, const Json& marginal,
                        const std::vector<double>* values) {
    ChartView view;
    ChartRange x;
    ChartRange y;
    y.include(0.0);
    const auto add = [&](ChartLayer layer) {
        if (layer.x.size() < 2) return;
        x.include(layer.x);
        y.include(layer.y);
        view.layers.push_back(std::move(layer));
    };
    if (values != nullptr) add(draw_columns(*values));
    add(laplace_density(block_at(marginal, "points")));
    if (view.layers.empty()) return view;
    const Json& entry = estimated_entry(result, name);
    add(normal_density(entry, x));
    add_reference(entry, view);
    view.label = name;
    view.x = x.axis(display_name(name), text_at(marginal.empty() ? entry : marginal, "unit"));
    view.y = y.axis("density", "");
    view.y.lower = 0.0;
    view.height = 0.45;
    return view;
}

const std::vector<double>* column_of(const std::optional<StoredDraws>& draws, const std::string& name) {
    if (!draws) return nullptr;
    const auto column = std::find(draws->names.begin(), draws->names.end(), name);
    return column == draws->names.end() ? nullptr
                                        : &draws->columns[static_cast<std::size_t>(column - draws->names.begin())];
}

/// Axis of one of the drawn quantities.
ChartAxis draws_axis(const Json& result, const std::string& name, std::vector<double> values) {
    std::sort(values.begin(), values.end());
    // The outermost draws of a thousand would leave the rest in a corner.
    const std::size_t cut = values.size() / 500;
    ChartRange range;
    range.include(values[cut]);
    range.include(values[values.size() - 1 - cut]);
    return range.axis(display_name(name), text_at(estimated_entry(result, name), "unit"));
}

}  // namespace

Chart profile_chart(const StoredRun& run) {
    Chart chart{"profiles", "Profile likelihood", "Parameter", {}, Chart::Arrangement::tiles};
    for (const auto& [name, profile] : block_at(run.result, "profile").items()) {
        if (!profile.is_object()) continue;
        ChartView view = profile_view(*run.result, name, profile);
        const Json& ends = block_at(profile, "interval95");
        if (!view.layers.empty() && ends_at(profile, "interval95"))
            append_words(chart.description,
                         fmt::format("{}: 95 % from {} to {}", name, ends[0].dump(), ends[1].dump()));
        chart.add(std::move(view));
    }
    return chart;
}

Chart marginal_chart(const StoredRun& run, const std::optional<StoredDraws>& draws) {
    Chart chart{"marginals", "Marginal posterior densities", "Quantity", {}, Chart::Arrangement::tiles};
    if (!run.result) return chart;
    const Json& marginals = block_at(run.result, "marginals");
    std::vector<std::string> names;
    for (const auto& [name, marginal] : marginals.items())
        names.push_back(name);
    if (draws) {
        for (const std::string& name : draws->names)
            if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
    for (const std::string& name : names)
        chart.add(marginal_view(*run.result, name, block_at(marginals, name), column_of(draws, name)));
    chart.description = fmt::format("densities of {} quantities", chart.views.size());
    return chart;
}

Chart posterior_chart(const StoredRun& run, const std::optional<StoredDraws>& draws) {
    Chart chart{"posterior", "Draws from the posterior, in pairs", "Quantities", {}, Chart::Arrangement::pairs};
    if (!run.result || !draws || draws->chain.empty()) return chart;
    // Pairs of the parameters; error scales and what does not fit on a page are left out.
    constexpr std::size_t most = 6;
    std::vector<std::size_t> shown;
    for (std::size_t c = 0; c < draws->names.size() && shown.size() < most; ++c)
        if (!estimated_entry(*run.result, draws->names[c]).empty()) shown.push_back(c);
    if (shown.empty()) shown.push_back(0);
    std::vector<ChartAxis> axes;
    for (const std::size_t c : shown)
        axes.push_back(draws_axis(*run.result, draws->names[c], draws->columns[c]));
    constexpr std::size_t most_dots = 700;  // of a cell: more only cover each other
    const std::size_t every = std::max<std::size_t>(1, draws->chain.size() / most_dots);
    for (std::size_t i = 0; i < shown.size(); ++i) {
        for (std::size_t j = 0; j <= i; ++j) {
            ChartView view;
            view.label = draws->names[shown[i]];
            view.x = axes[j];
            view.y = axes[i];
            view.height = 0.5;
            if (i == j) {
                view.layers = {draw_columns(draws->columns[shown[i]])};
                ChartRange heights;
                heights.include(view.layers[0].y);
                view.y = heights.axis("density", "");
                view.y.lower = 0.0;
            } else {
                ChartLayer dots{LayerKind::points, "draws", 2};
                for (std::size_t k = 0; k < draws->chain.size(); k += every)
                    dots.add(draws->columns[shown[j]][k], draws->columns[shown[i]][k]);
                view.label += " over " + draws->names[shown[j]];
                view.layers = {std::move(dots)};
            }
            chart.views.push_back(std::move(view));
        }
    }
    chart.description = fmt::format("{} draws of {} quantities, in pairs", draws->chain.size(), shown.size());
    return chart;
}

}  // namespace orbid::apps
