#include "apps/drawing/panel.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::apps {

namespace {

constexpr std::string_view grid_colour = "#e3e6eb";
constexpr std::string_view axis_colour = "#39424f";
constexpr std::string_view ink_colour = "#1d2430";
constexpr double hairline = 0.5;  ///< [pt], as journals ask for at least

double widest_tick(const Figure& figure, const PlotAxis& axis) {
    double widest = 0.0;
    for (const Tick& tick : axis.ticks)
        widest = std::max({widest, figure.width_of(tick.label), figure.width_of(tick.note, 0.9)});
    return widest;
}

/// Size of a label that is to fit into `room` [pt], as small as can be read at the least.
double fitting(const Figure& figure, std::string_view label, double room, double size) {
    return std::clamp(room / figure.width_of(label, size), size < 1.0 ? 0.4 : 0.6, 1.0) * size;
}

}  // namespace

double room_for(const Figure& figure, const PlotAxis& y) {
    return widest_tick(figure, y) + figure.font() * (y.label.empty() ? 0.9 : 2.4);
}

Panel::Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y)
    : Panel(figure, part, std::move(x), std::move(y), Options{}) {}

Panel::Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y, const Options& options)
    : figure_(figure), x_axis_(std::move(x)), y_axis_(std::move(y)), box_(part) {
    const double font = figure.font();
    box_.left += options.left > 0.0 ? options.left : options.y_labels ? room_for(figure, y_axis_) : 0.5 * font;
    box_.right -= options.right > 0.0 ? options.right : 1.1 * font;
    const double widest = widest_tick(figure, x_axis_);
    const bool turned =
        x_axis_.named && widest + 0.6 * font > box_.width() / std::max(1.0, static_cast<double>(x_axis_.ticks.size()));
    const double below = turned ? widest + 0.9 * font : 1.6 * font;
    box_.top += (options.tight ? 0.2 : 0.5) * font;
    box_.bottom -= options.x_labels ? below + (x_axis_.label.empty() ? 0.0 : 1.4 * font) : 0.4 * font;
    figure.rectangle(box_, "#ffffff");
    label_x(options, turned, below);
    label_y(options, part);
}

void Panel::label_x(const Options& options, bool turned, double below) {
    const double font = figure_.font();
    const double size = options.tight ? 0.8 : 1.0;
    double taken = -font;
    for (const Tick& tick : x_axis_.ticks) {
        const double at = x_axis_.at(tick.value, box_.left, box_.right);
        if (!x_axis_.named) figure_.line(at, box_.top, at, box_.bottom, {grid_colour, hairline});
        figure_.line(at, box_.bottom, at, box_.bottom + 0.35 * font, {axis_colour, hairline});
        if (!options.x_labels) continue;
        if (turned) {
            figure_.text(at + 0.34 * font, box_.bottom + 0.55 * font, tick.label, {"end", 1.0, ink_colour, false});
            continue;
        }
        const double half = 0.5 * figure_.width_of(tick.label, size);
        if (at - half < taken + 0.2 * font) continue;  // it would touch the one before
        figure_.text(at, box_.bottom + 1.3 * font, tick.label, {"middle", size});
        taken = at + half;
    }
    if (options.x_labels && !x_axis_.label.empty())
        figure_.text(
            0.5 * (box_.left + box_.right), box_.bottom + below + font, x_axis_.label,
            {"middle", fitting(figure_, x_axis_.label, box_.width() + (options.tight ? -0.5 : 1.0) * font, size)});
}

void Panel::label_y(const Options& options, const PageBox& part) {
    const double font = figure_.font();
    const double size = options.tight ? 0.8 : 1.0;
    double free = box_.bottom + font;  // labels above this touch none below
    for (const Tick& tick : y_axis_.ticks) {
        const double at = y_axis_.at(tick.value, box_.bottom, box_.top);
        if (!y_axis_.named) figure_.line(box_.left, at, box_.right, at, {grid_colour, hairline});
        figure_.line(box_.left - 0.35 * font, at, box_.left, at, {axis_colour, hairline});
        if (!options.y_labels || at > free) continue;
        const double left = box_.left - 0.55 * font;
        figure_.text(left, at + (tick.note.empty() ? 0.34 : -0.15) * font, tick.label, {"end", size});
        if (!tick.note.empty()) figure_.text(left, at + 0.95 * font, tick.note, {"end", 0.9, "#5b6675"});
        free = at - size * font;
    }
    if (options.y_labels && !y_axis_.label.empty())
        figure_.text(
            part.left + 1.05 * font, 0.5 * (box_.top + box_.bottom), y_axis_.label,
            {"middle", fitting(figure_, y_axis_.label, box_.height() + (options.tight ? -0.5 : 1.0) * font, size),
             ink_colour, false});
}

void Panel::open() {
    // A picture within the picture cuts off without an id, which several pictures of one page would share.
    figure_.element(
        "<svg x=\"{0:.2f}\" y=\"{1:.2f}\" width=\"{2:.2f}\" height=\"{3:.2f}\" viewBox=\"{0:.2f} {1:.2f} {2:.2f} "
        "{3:.2f}\" overflow=\"hidden\">\n",
        box_.left, box_.top, box_.width(), box_.height());
}

void Panel::frame() {
    figure_.element("</svg>\n");
    figure_.rectangle(box_, "none", {axis_colour, hairline});
}

void Panel::curve(std::span<const double> x, std::span<const double> y, const Stroke& stroke) {
    std::string path;
    double last_x = 0.0;
    double last_y = 0.0;
    bool joined = false;
    constexpr double visible = 0.1;  // pt; a vertex nearer than this to the one before cannot be seen
    for (std::size_t k = 0; k < std::min(x.size(), y.size()); ++k) {
        const double px = this->x(x[k]);
        const double py = this->y(y[k]);
        if (!std::isfinite(px) || !std::isfinite(py)) {
            joined = false;
            continue;
        }
        if (joined && k + 1 < x.size() && std::hypot(px - last_x, py - last_y) < visible) continue;
        path += fmt::format("{}{:.2f} {:.2f}", joined ? 'L' : 'M', px, py);
        last_x = px;
        last_y = py;
        joined = true;
    }
    figure_.path(path, "none", stroke, " stroke-linejoin=\"round\"");
}

void Panel::markers(std::span<const double> x, std::span<const double> y, const PlotMarker& marker, Filling filling) {
    std::string path;
    for (std::size_t k = 0; k < std::min(x.size(), y.size()); ++k) {
        const double px = this->x(x[k]);
        const double py = this->y(y[k]);
        if (std::isfinite(px) && std::isfinite(py)) path += fmt::format("M{:.2f} {:.2f}{}", px, py, marker.outline);
    }
    if (filling == Filling::open)
        figure_.path(path, "none", {marker.colour, 0.8});
    else
        figure_.path(path, marker.colour, {"#ffffff", filling == Filling::edged ? 0.3 : 0.0});
}

void Panel::tag(std::string_view words) {
    const double font = figure_.font();
    const double width = figure_.width_of(words, 0.9) + 0.6 * font;
    const double right = box_.right - 0.4 * font;
    figure_.rectangle({right - width, box_.top + 0.3 * font, right, box_.top + 1.6 * font}, "#ffffff", {}, 0.8);
    figure_.text(right - 0.3 * font, box_.top + 1.25 * font, words, {"end", 0.9});
}

void Panel::dots(std::span<const double> x, std::span<const double> y, std::string_view colour, double diameter,
                 double opacity) {
    // Lines of length zero with round ends, by short steps in twentieths of a point: eight bytes a dot.
    constexpr double grid = 20.0;
    std::string path;
    long last_x = 0;
    long last_y = 0;
    for (std::size_t k = 0; k < std::min(x.size(), y.size()); ++k) {
        const double px = this->x(x[k]);
        const double py = this->y(y[k]);
        if (!std::isfinite(px) || !std::isfinite(py)) continue;
        const long ix = std::lround(grid * px);
        const long iy = std::lround(grid * py);
        if (path.empty()) {
            path = fmt::format("M{} {}h0", ix, iy);
        } else if (ix != last_x || iy != last_y) {
            path += fmt::format("m{}{}{}h0", ix - last_x, iy < last_y ? "" : " ", iy - last_y);
        }
        last_x = ix;
        last_y = iy;
    }
    figure_.path(path, "none", {colour, grid * diameter, {}, opacity},
                 fmt::format(" transform=\"scale({:g})\" stroke-linecap=\"round\"", 1.0 / grid));
}

}  // namespace orbid::apps
