#pragma once

#include <string>
#include <string_view>

#include "apps/drawing/plot_axis.hpp"

namespace orbid::apps {

/// The page of a plot: where its frame lies, and the way from data to pixels. All lengths in px.
struct PlotFrame {
    static constexpr double width = 960.0;  ///< shown unscaled on the pages of the usual forges
    static constexpr double height = 680.0;
    static constexpr double left = 78.0;
    static constexpr double right = 936.0;
    static constexpr double top = 108.0;
    static constexpr double bottom = 618.0;

    PlotAxis x_axis;
    PlotAxis y_axis;

    [[nodiscard]] double x(double value) const { return x_axis.position(value, left, right); }
    [[nodiscard]] double y(double value) const { return y_axis.position(value, bottom, top); }

    /// Opening of the SVG with title, line below it and white background. Texts are escaped here.
    [[nodiscard]] std::string head(std::string_view title, std::string_view subtitle) const;
    /// Grid lines, tick labels and axis labels: goes below the data.
    [[nodiscard]] std::string grid() const;
    /// The frame itself: goes above the data.
    [[nodiscard]] std::string border() const;
};

}  // namespace orbid::apps
