#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/cycle.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// One periodic orbit in a plot of the section.
struct PlottedOrbit {
    int period = 1;
    Eigen::MatrixXd points;  ///< shape (n, p)
};

[[nodiscard]] std::vector<PlottedOrbit> plotted(const std::vector<orbits::Cycle>& cycles);

struct SectionPlotOptions {
    std::string title;                 ///< empty = "Section and periodic points"
    std::string subtitle;              ///< empty = the counts
    Eigen::Index x = 0;                ///< coordinate to the right
    Eigen::Index y = 1;                ///< coordinate upwards
    std::size_t maximum_dots = 60000;  ///< of the series; every k-th point is drawn. > 0
};

/// Picture (SVG 1.1) of a section series with its periodic points: dots shaded by the density of the whole series, the
/// orbits over it, coloured and shaped by period, legend, axes with units. Colours of Okabe and Ito, which people who
/// confuse colours can tell apart. The same input gives the same bytes.
///
/// Points with a missing coordinate are left out. About 8 bytes per dot, 50 per periodic point.
/// @throws std::invalid_argument when the series is not a section, x or y is no coordinate, or maximum_dots is 0.
[[nodiscard]] std::string section_svg(const orbits::Series& series, const std::vector<PlottedOrbit>& orbits,
                                      const SectionPlotOptions& options = {});

}  // namespace orbid::apps
