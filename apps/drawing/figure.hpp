#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>

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
    double width = 0.0;            ///< [pt]; 0: none
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
    /// Width that a text takes, about: fonts differ, and none is at hand here.
    [[nodiscard]] double width_of(std::string_view text, double size = 1.0) const;

    /// The next free part of the page, as wide as it.
    PageBox row(double height);
    /// A heading over the whole width, and what is shown below it: each where the style wants it and it is not empty.
    void title(std::string_view words, std::string_view description = {});
    /// Entries side by side; what needs more than six lines is left out.
    void legend(const std::vector<LegendEntry>& entries);

    /// Words over the whole width, in as many lines as they need.
    void paragraph(std::string_view words);

    void text(double x, double y, std::string_view words, const TextStyle& style = {});
    void line(double x1, double y1, double x2, double y2, const Stroke& stroke);
    void rectangle(const PageBox& box, std::string_view fill, const Stroke& stroke = {}, double opacity = 1.0);
    /// SVG path data, filled and stroked. @param attributes  more of the element, each with a space before it.
    void path(std::string_view outline, std::string_view fill, const Stroke& stroke, std::string_view attributes = {});
    /// An SVG element as it is.
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

}  // namespace orbid::apps
