#pragma once

#include <string>

#include "apps/drawing/chart.hpp"
#include "apps/drawing/plot_style.hpp"

namespace orbid::apps {

/// The still picture of a chart, SVG 1.1: its views as the chart arranges them, with axes, units and one legend for
/// all. Self-contained, without scripts, ids and style sheets, so that several may stand in one page of HTML. The same
/// chart and style give the same bytes.
/// @param chart    with one view or more.
/// @param heading  above the picture, where the style has a title.
/// @throws std::invalid_argument when the style is out of its ranges.
[[nodiscard]] std::string chart_svg(const Chart& chart, const std::string& heading, const PlotStyle& style);

}  // namespace orbid::apps
