#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "apps/drawing/plot_axis.hpp"
#include "apps/drawing/plot_marker.hpp"
#include "apps/drawing/plot_style.hpp"

namespace orbid::apps {

/// A rectangle on the page [pt], y downwards.
struct PageBox {
    double left = 0.0;
    double top = 0.0;
    double right = 0.0;
    double bottom = 0.0;
    [[nodiscard]] double width() const { return right - left; }
    [[nodiscard]] double height() const { return bottom - top; }
};

/// How a line is drawn; dashes tell lines apart where colours are not printed.
struct Stroke {
    std::string_view colour = "#1d2430";
    double width = 0.8;            ///< [pt]
    std::string_view dashes = {};  ///< SVG stroke-dasharray [pt]; empty: solid
    double opacity = 1.0;
};

/// Text on the page.
struct TextStyle {
    std::string_view anchor = "start";  ///< start | middle | end
    double size = 1.0;                  ///< in units of the figure's font
    std::string_view colour = "#1d2430";
    bool upright = true;  ///< false: turned by 90 degrees, reads upwards
    bool bold = false;
};

/// What stands in a legend before its words.
struct LegendEntry {
    std::string words;
    enum class Kind { marker, line, bar } kind = Kind::marker;
    PlotMarker marker = {};  ///< of a marker
    Stroke stroke = {};      ///< of a line, or the colour of a bar
    bool open = false;       ///< a marker without filling
};

/// A page that grows downwards while plots are drawn on it: width from the style, height from what was put there. All
/// lengths in pt, so that fonts and lines are what they say on paper.
class Figure {
public:
    /// @throws std::invalid_argument unless width_mm > 40 and font_pt in [4, 24].
    explicit Figure(const PlotStyle& style);

    [[nodiscard]] double width() const { return width_; }
    [[nodiscard]] double font() const { return font_; }
    /// Ticks that an axis over the whole width has room for.
    [[nodiscard]] int wanted_ticks() const { return std::max(4, static_cast<int>(width_ / (7.0 * font_))); }
    /// Width that a text takes, about: fonts differ, and none is at hand here.
    [[nodiscard]] double width_of(std::string_view text, double size = 1.0) const;

    /// The next free part of the page, as wide as it.
    PageBox row(double height);
    /// A heading over the whole width, and what is shown below it: each where the style wants it and it is not empty.
    void title(std::string_view words, std::string_view description = {});
    /// Entries side by side, in as many lines as they need.
    void legend(const std::vector<LegendEntry>& entries);

    void text(double x, double y, std::string_view words, const TextStyle& style = {});
    void line(double x1, double y1, double x2, double y2, const Stroke& stroke);
    void rectangle(const PageBox& box, std::string_view fill, const Stroke& stroke = {{}, 0.0});
    /// SVG elements as they are.
    void raw(std::string_view elements);
    template <class... T>
    void element(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(body_), format, std::forward<T>(values)...);
    }

    /// The whole picture. @param description  what is shown, for those who do not see it.
    [[nodiscard]] std::string svg(std::string_view title, std::string_view description) const;

private:
    double width_;
    double font_;
    bool titled_;
    bool described_;
    double bottom_;  ///< of what is on the page so far
    fmt::memory_buffer body_;
};

/// A frame with two axes within a part of the page; room for numbers and labels is taken from that part.
class Panel {
public:
    struct Options {
        bool x_labels = true;  ///< numbers and label below
        bool y_labels = true;
        bool grid = true;
        double left = 0.0;  ///< [pt] room for the numbers to the left; 0: as they need
    };
    Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y);
    Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y, const Options& options);

    [[nodiscard]] const PageBox& box() const { return box_; }
    [[nodiscard]] double x(double value) const { return x_axis_.position(value, box_.left, box_.right); }
    [[nodiscard]] double y(double value) const { return y_axis_.position(value, box_.bottom, box_.top); }
    [[nodiscard]] Figure& figure() { return figure_; }

    /// What follows is cut off at the frame, until frame().
    void open();
    /// Ends open(), and draws the frame over it.
    void frame();

    /// A line through the points; broken where a value is not finite, and where an angle came round.
    void curve(std::span<const double> x, std::span<const double> y, const Stroke& stroke);
    /// How markers are filled. edged: with a thin white edge that parts neighbours; plain: without, for dense ones;
    /// open: white within.
    enum class Filling { edged, plain, open };
    /// A marker at each finite point.
    void markers(std::span<const double> x, std::span<const double> y, const PlotMarker& marker,
                 Filling filling = Filling::edged);
    /// A word in the upper right corner, over what is drawn there.
    void tag(std::string_view words);
    /// Round dots, in one path: thousands of them stay small.
    void dots(std::span<const double> x, std::span<const double> y, std::string_view colour, double diameter,
              double opacity = 1.0);
    void horizontal(double y, const Stroke& stroke);
    void vertical(double x, const Stroke& stroke);

private:
    Figure& figure_;
    PlotAxis x_axis_;
    PlotAxis y_axis_;
    PageBox box_;
};

/// Ends of a logarithmic axis with a twentieth of its length to spare on either side.
[[nodiscard]] std::array<double, 2> spared_logarithmically(double lowest, double highest);

/// Room to the left of a frame for the numbers and the label of an axis [pt].
[[nodiscard]] double room_for(const Figure& figure, const PlotAxis& y);

}  // namespace orbid::apps
