#pragma once

namespace orbid::apps {

/// Size and manner of a plot.
struct PlotStyle {
    double width_mm = 88.0;  ///< of the page, in (40, 1000]; journals have columns of 84 to 90 and pages of 170 to 180
    double font_pt = 8.0;    ///< of numbers and labels on paper, in [4, 24]
    bool title = false;      ///< the run's title above; papers have captions instead
    bool description = false;  ///< below the title: what is shown, in figures
    double marks = 1.0;        ///< size of markers and dots beside what a column bears
    double height = 1.0;       ///< of frames beside what a column bears
};

/// The pictures that a run leaves in its folder: 960 px wide, as the usual forges show them unscaled.
inline constexpr PlotStyle run_picture_style{254.0, 10.5, true, true, 1.5, 0.85};

}  // namespace orbid::apps
