#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "orbits/records/series.hpp"

namespace orbid::tests {

/// One segment of a map x -> next(x), n coordinates, after 100 steps of transient.
template <std::size_t n, class Next>
Eigen::MatrixXd iterate(const Next& next, std::array<double, n> x, Eigen::Index count) {
    for (int i = 0; i < 100; ++i)
        x = next(x);
    Eigen::MatrixXd values(static_cast<Eigen::Index>(n), count);
    for (Eigen::Index i = 0; i < count; ++i) {
        for (std::size_t d = 0; d < n; ++d)
            values(static_cast<Eigen::Index>(d), i) = x[d];
        x = next(x);
    }
    return values;
}

inline orbits::Series section_series(std::vector<orbits::SeriesCoordinate> coordinates,
                                     std::vector<Eigen::MatrixXd> segments) {
    orbits::Series series;
    series.coordinates = std::move(coordinates);
    for (Eigen::MatrixXd& values : segments)
        series.segments.push_back({std::to_string(series.segments.size()), std::move(values), {}});
    return series;
}

inline std::array<double, 2> henon(const std::array<double, 2>& x) {
    return {1.0 - 1.4 * x[0] * x[0] + x[1], 0.3 * x[0]};
}

inline orbits::Series henon_series(Eigen::Index count) {
    return section_series({{"x", "", false}, {"y", "", false}}, {iterate<2>(henon, {0.1, 0.1}, count)});
}

/// Standard map, both coordinates angles; symmetric under x -> -x.
inline std::array<double, 2> standard_map(const std::array<double, 2>& x) {
    constexpr double turn = 2.0 * std::numbers::pi, kick = 7.0;
    const double y = std::remainder(x[1] + kick * std::sin(x[0]), turn);
    return {std::remainder(x[0] + y, turn), y};
}

inline orbits::Series standard_map_series(Eigen::Index count) {
    return section_series({{"x", "rad", true}, {"y", "rad", true}}, {iterate<2>(standard_map, {0.3, 0.2}, count)});
}

}  // namespace orbid::tests
