#pragma once

#include <string>
#include <string_view>

namespace orbid::apps {

/// How the periodic points of one period are drawn, in every plot alike.
struct PlotMarker {
    std::string_view colour;  ///< Okabe and Ito (2008), told apart by people who confuse colours
    std::string outline;      ///< SVG path data relative to the centre: follows an absolute move to it
};

/// Marker of a period (>= 1), its radius times `scale`: periods from 8 on share one. Longer periods are smaller,
/// because there are more of them.
[[nodiscard]] PlotMarker plot_marker(int period, double scale = 1.0);

}  // namespace orbid::apps
