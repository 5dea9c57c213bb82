#pragma once

#include <string>
#include <vector>

#include "models/parameter.hpp"
#include "orbits/series.hpp"

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

    bool circle = false;  ///< an angle: values are shown in (-pi, pi]

    /// Where a value lies between two ends of the axis on the page, as it is and brought onto the axis.
    [[nodiscard]] double at(double value, double at_lower, double at_upper) const {
        return at_lower + (at_upper - at_lower) * (value - lower) / (upper - lower);
    }
    [[nodiscard]] double position(double value, double at_lower, double at_upper) const {
        return at(circle ? models::wrapped(value) : value, at_lower, at_upper);
    }
};

/// Axis of a coordinate: angles show the whole circle (-pi, pi] with ticks at multiples of pi/2, others the range given
/// with 4 % to spare and about `wanted` ticks at 1, 2 or 5 times a power of ten.
///
/// @param lowest,highest  range of the data, ignored for angles; equal or not finite: one unit around it, or around 0.
[[nodiscard]] PlotAxis plot_axis(const orbits::SeriesCoordinate& coordinate, double lowest, double highest,
                                 int wanted = 7);

/// A coordinate's name for people: "phi" as the Greek letter, "phi_dot" as "dφ/dt", others as they are.
[[nodiscard]] std::string display_name(const std::string& name);

}  // namespace orbid::apps
