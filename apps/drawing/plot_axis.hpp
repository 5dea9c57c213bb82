#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "models/definition/parameter.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

struct Tick {
    double value;
    std::string label;
};

/// One axis of a plot: range, ticks and the words beside it.
struct PlotAxis {
    double lower = 0.0;
    double upper = 1.0;
    std::vector<Tick> ticks;
    std::string label;

    bool circle = false;       ///< an angle: values are shown in (-pi, pi]
    bool logarithmic = false;  ///< lower > 0; values <= 0 have no place: nan

    /// Where a value lies between two ends of the axis on the page, as it is and brought onto the axis.
    [[nodiscard]] double at(double value, double at_lower, double at_upper) const {
        const double share =
            logarithmic ? std::log(value / lower) / std::log(upper / lower) : (value - lower) / (upper - lower);
        return at_lower + (at_upper - at_lower) * share;
    }
    [[nodiscard]] double position(double value, double at_lower, double at_upper) const {
        return at(circle ? models::wrapped(value) : value, at_lower, at_upper);
    }
};

/// What an axis must show: the finite ones of all values included.
struct PlotRange {
    double lowest = std::numeric_limits<double>::infinity();
    double highest = -std::numeric_limits<double>::infinity();

    void include(double value) {
        if (!std::isfinite(value)) return;
        lowest = std::min(lowest, value);
        highest = std::max(highest, value);
    }
    void include(std::span<const double> values) {
        for (const double value : values)
            include(value);
    }
};

/// Axis of a coordinate: angles show the whole circle (-pi, pi] with ticks at multiples of pi/2, others the range given
/// with 4 % to spare, as linear_axis().
[[nodiscard]] PlotAxis plot_axis(const orbits::SeriesCoordinate& coordinate, const PlotRange& range, int wanted);

/// Axis from one value to another, for plots on paper: numbers stay short. A power of ten common to all goes into the
/// label ("l [10⁻³ m]"), and so does what is common to a range narrow beside its values ("l − 0.317 [10⁻⁹ m]").
///
/// @param unit  empty or "1": none is shown.
/// @param lowest,highest  range of the axis, without anything to spare; equal: 5 % around it, one unit around 0; not
/// finite: one unit
///                        around 0.
[[nodiscard]] PlotAxis linear_axis(const std::string& label, const std::string& unit, double lowest, double highest,
                                   int wanted = 5);

/// Logarithmic axis from one positive value to another, with ticks at powers of ten, and at 2 and 5 times these where
/// fewer than three would be left.
/// @param lowest,highest  anything but 0 < lowest < highest: a decade around 1, or around the one that is > 0.
[[nodiscard]] PlotAxis logarithmic_axis(const std::string& label, const std::string& unit, double lowest,
                                        double highest, int wanted = 6);

/// "−12" as "⁻¹²".
[[nodiscard]] std::string superscript(int exponent);

/// A coordinate's name for people: "phi" as the Greek letter, "phi_dot" as "dφ/dt", others as they are.
[[nodiscard]] std::string display_name(const std::string& name);

}  // namespace orbid::apps
