#include "orbits/series.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace orbid::orbits {
namespace {

/// Share of the values that the range leaves out at either end: 0.1 %, so that single wild readings of a long record
/// do not set the unit of distance.
constexpr double tail = 0.001;

/// Empirical quantile at position share * (count - 1), linear between neighbours. `values` is reordered; not empty.
double quantile(std::vector<double>& values, double share) {
    const double position = share * static_cast<double>(values.size() - 1);
    const auto below = static_cast<std::ptrdiff_t>(std::floor(position));
    const auto middle = values.begin() + below;
    std::nth_element(values.begin(), middle, values.end());
    if (middle + 1 == values.end()) return *middle;
    const double above = *std::min_element(middle + 1, values.end());
    return *middle + (position - static_cast<double>(below)) * (above - *middle);
}

}  // namespace

std::size_t Series::size() const {
    std::size_t points = 0;
    for (const Segment& segment : segments)
        points += static_cast<std::size_t>(segment.values.cols());
    return points;
}

bool Series::timed() const {
    if (sampling == Sampling::samples) return true;
    return !segments.empty() && std::all_of(segments.begin(), segments.end(), [](const Segment& segment) {
        return segment.times.size() > 0 && segment.times.size() == segment.values.cols();
    });
}

Eigen::VectorXd Series::scale() const {
    Eigen::VectorXd scale(dimension());
    for (Eigen::Index i = 0; i < dimension(); ++i) {
        scale[i] = 2.0 * std::numbers::pi;
        if (coordinates[static_cast<std::size_t>(i)].angle) continue;
        std::vector<double> values;
        values.reserve(size());
        for (const Segment& segment : segments) {
            for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
                if (std::isfinite(segment.values(i, k))) values.push_back(segment.values(i, k));
            }
        }
        const double range = values.empty() ? 0.0 : quantile(values, 1.0 - tail) - quantile(values, tail);
        // A constant coordinate separates no states: any unit does, and 1 keeps distances finite.
        scale[i] = range > 0.0 ? range : 1.0;
    }
    return scale;
}

}  // namespace orbid::orbits
