#pragma once

#include <span>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "apps/drawing/panel.hpp"

namespace orbid::apps {

/// Draws the layers of a view into its frame.
void draw_layers(Panel& panel, const std::vector<ChartLayer>& layers, const PlotStyle& style);

/// The names in views, each once, those of the topmost layers first.
[[nodiscard]] std::vector<LegendEntry> legend_of(std::span<const ChartView> views, const Figure& figure,
                                                 const PlotStyle& style);

}  // namespace orbid::apps
