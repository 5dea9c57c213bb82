#include "apps/drawing/chart_layer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>
#include <utility>

namespace orbid::apps {

namespace {

constexpr std::string_view dashes = "2.2 1.6";

std::string_view colour_of(const ChartLayer& layer) {
    switch (layer.ink) {
        case Ink::soft:
            return "#5b6675";
        case Ink::ink:
            return "#1d2430";
        case Ink::cloud:
            return "#8390a3";
        case Ink::of_style:
            break;
    }
    return plot_marker(layer.style).colour;
}

/// Lines of the paper's own colours are there for orientation, and thinner.
Stroke stroke_of(const ChartLayer& layer) {
    return {colour_of(layer), layer.ink == Ink::of_style && !layer.dash ? 1.1 : 0.7,
            layer.dash ? dashes : std::string_view()};
}

PlotMarker marker_of(const ChartLayer& layer, double scale) {
    return {colour_of(layer), plot_marker(layer.style, scale).outline};
}

/// Radius of markers: 1 gives that of a screen.
double marker_scale(double font, const PlotStyle& style) {
    return 0.045 * font * style.marks;
}

/// Light to dark, sparse to dense.
constexpr std::array<std::string_view, 5> shades{"#c3c9d2", "#a3adbb", "#8390a3", "#64738a", "#3f4d63"};

struct Dot {
    unsigned density;  ///< points of the whole section in its square
    std::size_t point;
};

/// Every k-th point, with the density there.
std::vector<Dot> thinned(const Panel& panel, std::span<const double> x, std::span<const double> y, double font) {
    // Squares of 0.35 mm on a column: small enough to follow the folds, large enough to count.
    const double cell = 0.125 * font;
    // Dots per square mm of the frame beyond which they only cover each other, and the most a page bears.
    constexpr double dense = 4.0;
    constexpr std::size_t most_of_all = 60000;
    const PageBox& box = panel.box();
    const auto columns = static_cast<std::size_t>(box.width() / cell) + 2;
    const auto rows = static_cast<std::size_t>(box.height() / cell) + 2;
    std::vector<unsigned> counts(columns * rows, 0);
    const auto square = [&](std::size_t k) -> std::ptrdiff_t {
        const double right = panel.x(x[k]) - box.left;
        const double down = panel.y(y[k]) - box.top;
        if (!(right >= 0.0 && right <= box.width() && down >= 0.0 && down <= box.height())) return -1;
        return static_cast<std::ptrdiff_t>(static_cast<std::size_t>(down / cell) * columns +
                                           static_cast<std::size_t>(right / cell));
    };
    for (std::size_t k = 0; k < x.size(); ++k)
        if (const auto at = square(k); at >= 0) ++counts[static_cast<std::size_t>(at)];
    const double area_mm2 = box.width() * box.height() * (25.4 / 72.0) * (25.4 / 72.0);
    const std::size_t most = std::clamp<std::size_t>(static_cast<std::size_t>(dense * area_mm2), 1, most_of_all);
    const std::size_t every = std::max<std::size_t>((x.size() + most - 1) / most, 1);
    std::vector<Dot> shown;
    for (std::size_t k = 0; k < x.size(); k += every)
        if (const auto at = square(k); at >= 0) shown.push_back({counts[static_cast<std::size_t>(at)], k});
    return shown;
}

/// Dots shaded by how many points of the whole record lie in their square.
void draw_density(Panel& panel, std::span<const double> x, std::span<const double> y, double diameter) {
    std::vector<Dot> shown = thinned(panel, x, y, panel.figure().font());
    std::stable_sort(shown.begin(), shown.end(), [](const Dot& a, const Dot& b) { return a.density < b.density; });
    for (std::size_t shade = 0; shade < shades.size(); ++shade) {
        // Shades hold equal numbers of dots: the picture uses its whole range whatever the density's.
        const auto begin = shown.begin() + static_cast<std::ptrdiff_t>(shown.size() * shade / shades.size());
        const auto end = shown.begin() + static_cast<std::ptrdiff_t>(shown.size() * (shade + 1) / shades.size());
        // In bands of 2 pt from left to right: steps from dot to dot are short then, and so is the path.
        constexpr double band = 2.0;
        std::sort(begin, end, [&](const Dot& a, const Dot& b) {
            const auto place = [&](const Dot& dot) {
                return std::make_tuple(std::floor(panel.y(y[dot.point]) / band), panel.x(x[dot.point]), dot.point);
            };
            return place(a) < place(b);
        });
        std::vector<double> across;
        std::vector<double> up;
        for (auto dot = begin; dot != end; ++dot) {
            across.push_back(x[dot->point]);
            up.push_back(y[dot->point]);
        }
        panel.dots(across, up, shades[shade], diameter);
    }
}

/// One dot for each square of 0.7 diameters that holds any point.
void draw_dots(Panel& panel, std::span<const double> x, std::span<const double> y, std::string_view colour,
               double diameter) {
    std::set<std::pair<long, long>> taken;
    std::vector<double> across;
    std::vector<double> up;
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double right = panel.x(x[k]) / (0.7 * diameter);
        const double down = panel.y(y[k]) / (0.7 * diameter);
        if (!std::isfinite(right) || !std::isfinite(down)) continue;
        if (!taken.emplace(std::lround(right), std::lround(down)).second) continue;
        across.push_back(x[k]);
        up.push_back(y[k]);
    }
    panel.dots(across, up, colour, diameter, 0.8);
}

/// Points of orbits are all shown; of others many are small marks, and more than these are dots.
void draw_points(Panel& panel, const ChartLayer& layer, const PlotStyle& style) {
    constexpr std::size_t few = 120;
    constexpr std::size_t many = 400;
    const double font = panel.figure().font();
    const std::size_t count = layer.orbits > 0 ? 0 : layer.x.size();
    if (count > many) return draw_dots(panel, layer.x, layer.y, colour_of(layer), 0.14 * font * style.marks);
    const PlotMarker marker = marker_of(layer, (count > few ? 0.5 : 1.0) * marker_scale(font, style));
    panel.markers(layer.x, layer.y, marker,
                  layer.open    ? Panel::Filling::open
                  : count > few ? Panel::Filling::plain
                                : Panel::Filling::edged);
}

void draw_band(Panel& panel, const ChartLayer& layer) {
    std::string path;
    const auto to = [&](std::size_t k, double value) {
        path += fmt::format("{}{:.2f} {:.2f}", path.empty() ? 'M' : 'L', panel.x(layer.x[k]), panel.y(value));
    };
    for (std::size_t k = 0; k < layer.x.size(); ++k)
        to(k, layer.upper[k]);
    for (std::size_t k = layer.x.size(); k-- > 0;)
        to(k, layer.lower[k]);
    panel.figure().path(path, colour_of(layer), {}, " fill-opacity=\"0.12\"");
}

void draw_bars(Panel& panel, const ChartLayer& layer) {
    std::string path;
    for (std::size_t k = 0; k < layer.y.size(); ++k)
        path += fmt::format("M{:.2f} {:.2f}V{:.2f}H{:.2f}V{:.2f}z", panel.x(layer.x[k]), panel.y(0.0),
                            panel.y(layer.y[k]), panel.x(layer.x[k + 1]), panel.y(0.0));
    panel.figure().path(path, colour_of(layer), {"#ffffff", 0.25}, " fill-opacity=\"0.4\"");
}

void draw_intervals(Panel& panel, const ChartLayer& layer) {
    const double foot = 0.28 * panel.figure().font();
    const bool upright = !layer.x.empty();
    std::string path;
    const auto add = [&](double x1, double y1, double x2, double y2) {
        path += fmt::format("M{:.2f} {:.2f}L{:.2f} {:.2f}", x1, y1, x2, y2);
    };
    for (std::size_t k = 0; k < layer.lower.size(); ++k) {
        if (!std::isfinite(layer.lower[k]) || !std::isfinite(layer.upper[k])) continue;
        if (upright) {
            const double at = panel.x(layer.x[k]);
            add(at, panel.y(layer.lower[k]), at, panel.y(layer.upper[k]));
            continue;
        }
        const double at = panel.y(layer.y[k]);
        add(panel.x(layer.lower[k]), at, panel.x(layer.upper[k]), at);
        for (const double end : {layer.lower[k], layer.upper[k]})
            add(panel.x(end), at - foot, panel.x(end), at + foot);
    }
    panel.figure().path(path, "none", {colour_of(layer), upright ? 0.7 : 1.1});
}

void draw_rule(Panel& panel, const ChartLayer& layer) {
    const PageBox& box = panel.box();
    if (layer.at_x)
        panel.figure().line(panel.x(*layer.at_x), box.top, panel.x(*layer.at_x), box.bottom, stroke_of(layer));
    if (layer.at_y)
        panel.figure().line(box.left, panel.y(*layer.at_y), box.right, panel.y(*layer.at_y), stroke_of(layer));
}

/// From white to blue (positive) or orange (negative); the label holds the sign, too.
std::string cell_colour(double value) {
    const double strength = std::isfinite(value) ? std::min(1.0, std::abs(value)) : 0.0;
    const auto mix = [strength](int full) { return static_cast<int>(255.0 - strength * (255 - full) + 0.5); };
    return value >= 0.0 ? fmt::format("#{:02x}{:02x}{:02x}", mix(0x2b), mix(0x7b), mix(0xb9))
                        : fmt::format("#{:02x}{:02x}{:02x}", mix(0xe0), mix(0x82), mix(0x1e));
}

void draw_cells(Panel& panel, const ChartLayer& layer) {
    Figure& figure = panel.figure();
    const double width = panel.x(1.0) - panel.x(0.0);
    double widest = 1.0;
    for (const std::string& label : layer.labels)
        widest = std::max(widest, figure.width_of(label));
    // Labels where they can be read; the colours say the same.
    const double size = std::min(0.95, 0.9 * width / widest);
    for (std::size_t k = 0; k < layer.x.size(); ++k) {
        figure.rectangle({panel.x(layer.x[k] - 0.5), panel.y(layer.y[k] + 0.5), panel.x(layer.x[k] + 0.5),
                          panel.y(layer.y[k] - 0.5)},
                         cell_colour(layer.shade[k]), {"#ffffff", 0.8});
        if (size < 0.5) continue;
        figure.text(panel.x(layer.x[k]), panel.y(layer.y[k]) + 0.34 * size * figure.font(), layer.labels[k],
                    {"middle", size, std::abs(layer.shade[k]) > 0.8 ? "#ffffff" : "#1d2430"});
    }
}

}  // namespace

void draw_layers(Panel& panel, const std::vector<ChartLayer>& layers, const PlotStyle& style) {
    panel.open();
    for (const ChartLayer& layer : layers) {
        if (layer.kind == LayerKind::points && layer.orbits == 0) draw_points(panel, layer, style);
        if (layer.kind == LayerKind::density)
            draw_density(panel, layer.x, layer.y, 0.07 * panel.figure().font() * style.marks);
        if (layer.kind == LayerKind::line) panel.curve(layer.x, layer.y, stroke_of(layer));
        if (layer.kind == LayerKind::band) draw_band(panel, layer);
        if (layer.kind == LayerKind::bars) draw_bars(panel, layer);
        if (layer.kind == LayerKind::intervals) draw_intervals(panel, layer);
        if (layer.kind == LayerKind::rule) draw_rule(panel, layer);
        if (layer.kind == LayerKind::cells) draw_cells(panel, layer);
    }
    panel.frame();
    // Points of orbits over the frame, where angles come round.
    for (const ChartLayer& layer : layers)
        if (layer.kind == LayerKind::points && layer.orbits > 0) draw_points(panel, layer, style);
}

std::vector<LegendEntry> legend_of(std::span<const ChartView> views, const Figure& figure, const PlotStyle& style) {
    std::vector<LegendEntry> legend;
    std::vector<std::string> seen;
    for (const ChartView& view : views) {
        for (auto layer = view.layers.rbegin(); layer != view.layers.rend(); ++layer) {
            if (layer->name.empty() || std::find(seen.begin(), seen.end(), layer->name) != seen.end()) continue;
            seen.push_back(layer->name);
            LegendEntry entry{layer->name};
            if (layer->orbits > 0)
                entry.words += style.description
                                   ? fmt::format(": {} orbit{}", layer->orbits, layer->orbits == 1 ? "" : "s")
                                   : fmt::format(" ({})", layer->orbits);
            entry.marker = marker_of(*layer, marker_scale(figure.font(), style));
            entry.stroke = stroke_of(*layer);
            entry.open = layer->open;
            if (layer->kind == LayerKind::density || layer->kind == LayerKind::band || layer->kind == LayerKind::bars)
                entry.kind = LegendEntry::Kind::bar;
            else if (layer->kind != LayerKind::points)
                entry.kind = LegendEntry::Kind::line;
            legend.push_back(std::move(entry));
        }
    }
    return legend;
}

}  // namespace orbid::apps
