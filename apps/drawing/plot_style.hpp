#pragma once

namespace orbid::apps {

/// Size and manner of a plot.
struct PlotStyle {
    double width_mm = 88.0;  ///< of the page, in (40, 1000]; journals have columns of 84 to 90 and pages of 170 to 180
    double font_pt = 8.0;    ///< of numbers and labels on paper, in [4, 24]
    bool title = false;      ///< the run's title above; papers have captions instead
};

}  // namespace orbid::apps
