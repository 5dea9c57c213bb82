#pragma once

#include <span>
#include <string_view>

#include "apps/drawing/figure.hpp"
#include "apps/drawing/plot_axis.hpp"

namespace orbid::apps {

/// A frame with two axes within a part of the page; room for numbers and labels is taken from that part.
class Panel {
public:
    struct Options {
        bool x_labels = true;  ///< numbers and label below
        bool y_labels = true;
        bool tight = false;  ///< one of many: small numbers, hardly any room between frames
        double left = 0.0;   ///< [pt] room for the numbers to the left; 0: as they need
        double right = 0.0;  ///< [pt] room to the right; 0: half of the last number
    };
    Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y);
    Panel(Figure& figure, const PageBox& part, PlotAxis x, PlotAxis y, const Options& options);

    [[nodiscard]] const PageBox& box() const { return box_; }
    [[nodiscard]] double x(double value) const { return x_axis_.at(value, box_.left, box_.right); }
    [[nodiscard]] double y(double value) const { return y_axis_.at(value, box_.bottom, box_.top); }
    [[nodiscard]] Figure& figure() { return figure_; }

    /// What follows is cut off at the frame, until frame().
    void open();
    /// Ends open(), and draws the frame over it.
    void frame();

    /// A line through the points; broken where a value is not finite.
    void curve(std::span<const double> x, std::span<const double> y, const Stroke& stroke);
    /// How markers are filled. edged: with a thin white edge that parts neighbours; plain: without, for dense ones;
    /// open: outlines alone.
    enum class Filling { edged, plain, open };
    /// A marker at each finite point.
    void markers(std::span<const double> x, std::span<const double> y, const PlotMarker& marker,
                 Filling filling = Filling::edged);
    /// A word in the upper right corner, over what is drawn there.
    void tag(std::string_view words);
    /// Round dots, in one path: thousands of them stay small.
    void dots(std::span<const double> x, std::span<const double> y, std::string_view colour, double diameter,
              double opacity = 1.0);

private:
    void label_x(const Options& options, bool turned, double below);
    void label_y(const Options& options, const PageBox& part);

    Figure& figure_;
    PlotAxis x_axis_;
    PlotAxis y_axis_;
    PageBox box_;
};

/// Room to the left of a frame for the numbers and the label of an axis [pt].
[[nodiscard]] double room_for(const Figure& figure, const PlotAxis& y);

}  // namespace orbid::apps
