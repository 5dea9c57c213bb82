#include "orbits/sections/plane_choice.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "orbits/records/refusal.hpp"
#include "orbits/sections/time_smoothing.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;

constexpr double band_share = 0.02;
constexpr std::array<double, 3> quantiles{0.5, 0.35, 0.65};
constexpr double band_noise = 4.0;
constexpr std::size_t fewest_returns = 2;
constexpr double enough_crossings = 0.5;

/// When a coordinate passes a band.
struct Passages {
    std::vector<double> returns;  ///< [s]
    std::size_t count = 0;
};

void add_passages(const Segment& segment, const PlaneCrossing& crossing, double band, Passages& passages) {
    constexpr double never = std::numeric_limits<double>::quiet_NaN();
    Index below = -1;  // the last sample before the band
    double last = never;
    for (Index k = 0; k < segment.values.cols(); ++k) {
        const double reading = segment.values(crossing.coordinate, k);
        if (!std::isfinite(reading)) {
            below = -1;
            last = never;
            continue;
        }
        const double y = crossing.direction * (reading - crossing.value);
        if (y < -band) {
            below = k;
        } else if (y > band && below >= 0) {
            const double middle = 0.5 * (segment.times[below] + segment.times[k]);
            if (std::isfinite(last)) passages.returns.push_back(middle - last);
            last = middle;
            ++passages.count;
            below = -1;
        }
    }
}

ChosenPlane judged(const Series& samples, const PlaneCrossing& crossing, double range, double noise) {
    const double band = std::max(band_share * range, band_noise * noise);
    Passages passages;
    for (const Segment& segment : samples.segments)
        if (segment.values.cols() > 1) add_passages(segment, crossing, band, passages);
    ChosenPlane plane{crossing, passages.count, 0.0, std::numeric_limits<double>::infinity()};
    if (passages.returns.size() < fewest_returns) return plane;
    double sum = 0.0, square = 0.0;
    for (const double time : passages.returns) {
        sum += time;
        square += time * time;
    }
    const auto number = static_cast<double>(passages.returns.size());
    plane.mean_return = sum / number;
    plane.unevenness =
        std::sqrt(std::max(square / number - plane.mean_return * plane.mean_return, 0.0)) / plane.mean_return;
    return plane;
}

}  // namespace

ChosenPlane choose_plane(const Series& samples, const std::vector<bool>& zero) {
    check_samples(samples, "choose_plane");
    (void)sampling_interval(samples, "choose_plane");
    const Eigen::VectorXd scale = samples.scale();
    std::vector<ChosenPlane> planes;
    for (Index c = 0; c < samples.dimension(); ++c) {
        if (samples.coordinate(c).angle) continue;
        std::vector<double> readings;
        for (const Segment& segment : samples.segments)
            for (const double y : segment.values.row(c))
                if (std::isfinite(y)) readings.push_back(y);
        if (readings.empty()) continue;
        const bool at_zero = static_cast<std::size_t>(c) < zero.size() && zero[static_cast<std::size_t>(c)];
        std::sort(readings.begin(), readings.end());
        const double noise = std::sqrt(difference_variance(samples, c));
        for (const double share : quantiles) {
            const auto at = static_cast<std::size_t>(share * static_cast<double>(readings.size()));
            for (const int direction : {1, -1})
                planes.push_back(judged(samples, {c, at_zero ? 0.0 : readings[at], direction}, scale[c], noise));
            if (at_zero) break;
        }
    }
    std::size_t most = 0;
    for (const ChosenPlane& plane : planes)
        if (std::isfinite(plane.unevenness)) most = std::max(most, plane.crossings);
    refuse_record_if(most == 0, "no plane is crossed three times by a segment: the record is too short, or at rest");
    const ChosenPlane* best = nullptr;
    for (const ChosenPlane& plane : planes) {
        if (static_cast<double>(plane.crossings) < enough_crossings * static_cast<double>(most)) continue;
        if (best == nullptr || plane.unevenness < best->unevenness) best = &plane;
    }
    return *best;
}

}  // namespace orbid::orbits
