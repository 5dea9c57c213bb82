#include "apps/drawing/figure.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "apps/drawing/markup_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

constexpr double pt_per_mm = 72.0 / 25.4;
/// Mean width of a character of a sans serif font, in units of its size; DejaVu, the widest of the usual, has 0.6.
constexpr double character_width = 0.58;
constexpr std::string_view grid_colour = "#e3e6eb";
constexpr std::string_view axis_colour = "#39424f";
constexpr double hairline = 0.5;  ///< [pt], as journals ask for at least

std::string stroke_attributes(const Stroke& stroke) {
    std::string out = fmt::format("stroke=\"{}\" stroke-width=\"{:g}\"", stroke.colour, stroke.width);
    if (!stroke.dashes.empty()) out += fmt::format(" stroke-dasharray=\"{}\"", stroke.dashes);
    if (stroke.opacity < 1.0) out += fmt::format(" stroke-opacity=\"{:g}\"", stroke.opacity);
    return out;
}

}  // namespace

Figure::Figure(const PlotStyle& style)
    : width_(style.width_mm * pt_per_mm),
      font_(style.font_pt),
      titled_(style.title),
      described_(style.description),
      bottom_(0.35 * style.font_pt) {
    if (!(style.width_mm > 40.0 && style.width_mm <= 1000.0))
        throw std::invalid_argument(fmt::format("plot: width {} mm, must be in (40, 1000]", style.width_mm));
    if (!(style.font_pt >= 4.0 && style.font_pt <= 24.0))
        throw std::invalid_argument(fmt::format("plot: font of {} pt, must be in [4, 24]", style.font_pt));
}

double Figure::width_of(std::string_view text, double size) const {
    return character_width * size * font_ * static_cast<double>(shown_width(text));
}

PageBox Figure::row(double height) {
    const PageBox box{0.0, bottom_, width_, bottom_ + height};
    bottom_ += height;
    return box;
}

void Figure::title(std::string_view words, std::string_view description) {
    if (titled_ && !words.empty()) {
        const PageBox box = row(1.7 * font_);
        text(0.5 * font_, box.top + 1.15 * font_, words, {"start", 1.1, "#1d2430", true, true});
    }
    if (described_ && !description.empty()) {
        const PageBox box = row(1.6 * font_);
        text(0.5 * font_, box.top + 1.0 * font_, description, {"start", 0.94, "#5b6675"});
    }
}

void Figure::legend(const std::vector<LegendEntry>& entries) {
    if (entries.empty()) return;
    const double symbol = 1.9 * font_;
    const double gap = 1.1 * font_;
    double x = 0.7 * font_;
    PageBox line_box = row(1.55 * font_);
    for (const LegendEntry& entry : entries) {
        const double needed = symbol + width_of(entry.words);
        if (x + needed > width_ && x > font_) {
            line_box = row(1.4 * font_);
            x = 0.7 * font_;
        }
        const double middle = line_box.top + 0.75 * font_;
        if (entry.kind == LegendEntry::Kind::marker) {
            element("<path fill=\"{}\" stroke=\"{}\" stroke-width=\"{:g}\" d=\"M{:.2f} {:.2f}{}\"/>\n",
                    entry.open ? std::string_view("#ffffff") : entry.marker.colour,
                    entry.open ? entry.marker.colour : std::string_view("#ffffff"), entry.open ? 0.8 : 0.4,
                    x + 0.5 * symbol, middle, entry.marker.outline);
        } else if (entry.kind == LegendEntry::Kind::line) {
            line(x, middle, x + 0.8 * symbol, middle, entry.stroke);
        } else {
            rectangle({x, middle - 0.35 * font_, x + 0.75 * symbol, middle + 0.35 * font_}, entry.stroke.colour);
        }
        text(x + symbol, middle + 0.33 * font_, entry.words, {"start", 0.94});
        x += needed + gap;
    }
    row(0.2 * font_);
}

void Figure::text(double x, double y, std::string_view words, const TextStyle& style) {
    const std::string place = style.upright ? fmt::format("x=\"{:.2f}\" y=\"{:.2f}\"", x, y)
                                            : fmt::format("transform=\"translate({:.2f} {:.2f}) rotate(-90)\"", x, y);
    element("<text {} text-anchor=\"{}\" font-size=\"{:g}\" fill=\"{}\"{}>{}</text>\n", place, style.anchor,
            std::round(100.0 * style.size * font_) / 100.0, style.colour, style.bold ? " font-weight=\"600\"" : "",
            markup_text(words));
}

void Figure::line(double x1, double y1, double x2, double y2, const Stroke& stroke) {
    element("<path fill=\"none\" {} d=\"M{:.2f} {:.2f}L{:.2f} {:.2f}\"/>\n", stroke_attributes(stroke), x1, y1, x2, y2);
}

void Figure::rectangle(const PageBox& box, std::string_view fill, const Stroke& stroke) {
    element("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"{}{}/>\n", box.left, box.top,
            box.width(), box.height(), fill, stroke.width > 0.0 ? " " : "",
            stroke.width > 0.0 ? stroke_attributes(stroke) : std::string());
}

void Figure::raw(std::string_view elements) {
    body_.append(elements);
}

std::string Figure::svg(std::string_view title, std::string_view description) const {
    const double height = bottom_ + 0.35 * font_;
    return fmt::format(
               "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.2f}mm\" height=\"{:.2f}mm\" "
               "viewBox=\"0 0 {:.2f} {:.2f}\" role=\"img\" "
               "font-family=\"Helvetica,Arial,'Liberation Sans','DejaVu Sans',sans-serif\">\n"
               "<title>{}</title>\n<desc>{}</desc>\n<rect width=\"{:.2f}\" height=\"{:.2f}\" fill=\"#ffffff\"/>\n",
               width_ / pt_per_mm, height / pt_per_mm, width_, height, markup_text(title), markup_text(description),
               width_, height) +
           fmt::to_string(body_) + "</svg>\n";
}

std::array<double, 2> spared_logarithmically(double lowest, double highest) {
    if (!(lowest > 0.0 && highest > lowest)) return {lowest, highest};
    const double spare = std::pow(highest / lowest, 0.05);
    return {lowest / spare, highest * spare};
}

double room_for(const Figure& figure, const PlotAxis& y) {
    double widest = 0.0;
    for (const Tick& tick : y.ticks)
        widest = std::max(widest, figure.width_of(tick.label));
    return widest + figure.font() * (y.label.empty() ? 0.9 : 2.4);
}

Panel::Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y)
    : Panel(figure, part, std::move(x), std::move(y), Options{}) {}

Panel::Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y, const Options& options)
    : figure_(figure), x_axis_(std::move(x)), y_axis_(std::move(y)), box_(part) {
    const double font = figure.font();
    box_.top += 0.5 * font;
    box_.bottom -= options.x_labels ? font * (x_axis_.label.empty() ? 1.6 : 3.0) : 0.4 * font;
    box_.left += options.left > 0.0 ? options.left : options.y_labels ? room_for(figure, y_axis_) : 0.5 * font;
    box_.right -= 1.1 * font;  // half of the last number
    figure.rectangle(box_, "#ffffff");
    for (const Tick& tick : x_axis_.ticks) {
        const double at = x_axis_.at(tick.value, box_.left, box_.right);
        if (options.grid) figure.line(at, box_.top, at, box_.bottom, {grid_colour, hairline});
        figure.line(at, box_.bottom, at, box_.bottom + 0.35 * font, {axis_colour, hairline});
        if (options.x_labels) figure.text(at, box_.bottom + 1.3 * font, tick.label, {"middle"});
    }
    for (const Tick& tick : y_axis_.ticks) {
        const double at = y_axis_.at(tick.value, box_.bottom, box_.top);
        if (options.grid) figure.line(box_.left, at, box_.right, at, {grid_colour, hairline});
        figure.line(box_.left - 0.35 * font, at, box_.left, at, {axis_colour, hairline});
        if (options.y_labels) figure.text(box_.left - 0.55 * font, at + 0.34 * font, tick.label, {"end"});
    }
    if (options.x_labels && !x_axis_.label.empty())
        figure.text(0.5 * (box_.left + box_.right), box_.bottom + 2.6 * font, x_axis_.label, {"middle"});
    if (options.y_labels && !y_axis_.label.empty())
        figure.text(part.left + 1.05 * font, 0.5 * (box_.top + box_.bottom), y_axis_.label,
                    {"middle", 1.0, "#1d2430", false});
}

void Panel::open() {
    // A picture within the picture cuts off without an id, which several pictures of one page would share.
    figure_.element(
        "<svg x=\"{0:.2f}\" y=\"{1:.2f}\" width=\"{2:.2f}\" height=\"{3:.2f}\" viewBox=\"{0:.2f} {1:.2f} {2:.2f} "
        "{3:.2f}\" overflow=\"hidden\">\n",
        box_.left, box_.top, box_.width(), box_.height());
}

void Panel::frame() {
    figure_.raw("</svg>\n");
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
        const bool round = y_axis_.circle && std::abs(py - last_y) > 0.5 * box_.height();
        if (joined && !round && k + 1 < x.size() && std::hypot(px - last_x, py - last_y) < visible) continue;
        path += fmt::format("{}{:.2f} {:.2f}", joined && !round ? 'L' : 'M', px, py);
        last_x = px;
        last_y = py;
        joined = true;
    }
    if (path.empty()) return;
    figure_.element("<path fill=\"none\" {} stroke-linejoin=\"round\" d=\"{}\"/>\n", stroke_attributes(stroke), path);
}

void Panel::markers(std::span<const double> x, std::span<const double> y, const PlotMarker& marker, Filling filling) {
    std::string path;
    for (std::size_t k = 0; k < std::min(x.size(), y.size()); ++k) {
        const double px = this->x(x[k]);
        const double py = this->y(y[k]);
        if (std::isfinite(px) && std::isfinite(py)) path += fmt::format("M{:.2f} {:.2f}{}", px, py, marker.outline);
    }
    if (path.empty()) return;
    std::string edge;
    if (filling == Filling::edged) edge = stroke_attributes({"#ffffff", 0.3});
    if (filling == Filling::open) edge = stroke_attributes({marker.colour, 0.8});
    figure_.element("<path fill=\"{}\" {} d=\"{}\"/>\n",
                    filling == Filling::open ? std::string_view("#ffffff") : marker.colour, edge, path);
}

void Panel::tag(std::string_view words) {
    const double font = figure_.font();
    const double width = figure_.width_of(words, 0.9) + 0.6 * font;
    const double right = box_.right - 0.4 * font;
    figure_.element(
        "<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"#ffffff\" fill-opacity=\"0.8\"/>\n",
        right - width, box_.top + 0.3 * font, width, 1.3 * font);
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
    if (path.empty()) return;
    figure_.element("<path fill=\"none\" transform=\"scale({:g})\" {} stroke-linecap=\"round\" d=\"{}\"/>\n",
                    1.0 / grid, stroke_attributes({colour, grid * diameter, {}, opacity}), path);
}

void Panel::horizontal(double y, const Stroke& stroke) {
    figure_.line(box_.left, this->y(y), box_.right, this->y(y), stroke);
}

void Panel::vertical(double x, const Stroke& stroke) {
    figure_.line(this->x(x), box_.top, this->x(x), box_.bottom, stroke);
}

}  // namespace orbid::apps
