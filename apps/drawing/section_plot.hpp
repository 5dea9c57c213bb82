#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/drawing/chart.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// Points of a section, for a plot of two of their coordinates.
struct SectionPoints {
    std::array<orbits::SeriesCoordinate, 2> coordinates;
    std::vector<double> x;
    std::vector<double> y;
};

/// Two coordinates of a section series. Points where one of them is missing are left out.
/// @throws std::invalid_argument when the series is not a section; models::Stopped.
/// @throws std::out_of_range when x or y is no coordinate.
[[nodiscard]] SectionPoints section_points(const orbits::Series& series, Eigen::Index x = 0, Eigen::Index y = 1,
                                           const std::function<bool()>& interrupted = {});

/// The points of all periodic orbits of one period.
struct PeriodPoints {
    std::vector<double> x;
    std::vector<double> y;
    std::size_t orbits = 0;
    std::vector<std::string> labels = {};  ///< what a live chart says of each; may be empty
};

/// What a picture of a section shows.
struct SectionPicture {
    SectionPoints section;
    std::map<int, PeriodPoints> periods;
    std::string title;        ///< for those who do not see it
    std::string description;  ///< empty: how many points and orbits there are

    /// Adds the points of an orbit, shape (n, p), in their coordinates x and y.
    void add_orbit(int period, const Eigen::MatrixXd& points, Eigen::Index x = 0, Eigen::Index y = 1);
};

/// The section as a chart: dots shaded by the density of all points, where there are any, the orbits over it, coloured
/// and shaped by period.
[[nodiscard]] Chart section_chart(const SectionPicture& picture);

}  // namespace orbid::apps
