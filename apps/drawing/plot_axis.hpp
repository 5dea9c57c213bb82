#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "apps/drawing/chart.hpp"

namespace orbid::apps {

struct Tick {
    double value;
    std::string label;
    std::string note = {};  ///< in a line of its own below the label
};

/// One axis on the page: range, ticks and the words beside it.
struct PlotAxis {
    double lower = 0.0;
    double upper = 1.0;
    std::vector<Tick> ticks;
    std::string label;
    bool logarithmic = false;  ///< lower > 0; values <= 0 have no place: nan
    bool named = false;        ///< ticks are names

    /// Where a value lies between two ends of the axis on the page.
    [[nodiscard]] double at(double value, double at_lower, double at_upper) const {
        const double share =
            logarithmic ? std::log(value / lower) / std::log(upper / lower) : (value - lower) / (upper - lower);
        return at_lower + (at_upper - at_lower) * share;
    }
};

/// The axis of a chart with about `wanted` ticks: names, parts of pi, whole numbers, powers of ten, or as
/// linear_axis().
[[nodiscard]] PlotAxis plot_axis(const ChartAxis& axis, int wanted);

/// Axis from one value to another, for plots on paper: numbers stay short. A power of ten common to all goes into the
/// label ("l [10⁻³ m]"), and so does what is common to a range narrow beside its values ("l − 0.317 [10⁻⁹ m]").
///
/// @param unit  empty or "1": none is shown.
/// @param lowest,highest  range of the axis, without anything to spare; equal: 5 % around it, one unit around 0; not
///                        finite: one unit around 0.
[[nodiscard]] PlotAxis linear_axis(const std::string& label, const std::string& unit, double lowest, double highest,
                                   int wanted = 5);

/// Logarithmic axis from one positive value to another, with ticks at powers of ten, and at 2 and 5 times these where
/// fewer than three would be left.
/// @param lowest,highest  anything but 0 < lowest < highest: a decade around 1, or around the one that is > 0.
[[nodiscard]] PlotAxis logarithmic_axis(const std::string& label, const std::string& unit, double lowest,
                                        double highest, int wanted = 6);

/// "−12" as "⁻¹²".
[[nodiscard]] std::string superscript(int exponent);

}  // namespace orbid::apps
