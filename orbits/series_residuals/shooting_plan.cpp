#include "orbits/series_residuals/shooting_plan.hpp"

#include <cmath>
#include <numbers>

namespace orbid::orbits {
namespace {

using Eigen::Index;

constexpr double same_instant = 1e-10;  // of a sampling interval: what rounding of times read from a file leaves

bool equal(const InstantPattern& a, const InstantPattern& b, double tolerance) {
    if (a.match != b.match || a.input != b.input || a.instants.size() != b.instants.size()) return false;
    for (std::size_t j = 0; j < a.instants.size(); ++j)
        if (a.instants[j].delayed != b.instants[j].delayed ||
            !(std::abs(a.instants[j].after - b.instants[j].after) <= tolerance))
            return false;
    return true;
}

/// Index of the pattern among the last ones; a new one when it is none of them. Regular records have three: inside, at
/// the end and before the end of a segment.
std::size_t place(std::vector<InstantPattern>& patterns, InstantPattern pattern, double tolerance) {
    constexpr std::size_t remembered = 16;
    const std::size_t oldest = patterns.size() > remembered ? patterns.size() - remembered : 0;
    for (std::size_t p = patterns.size(); p-- > oldest;)
        if (equal(patterns[p], pattern, tolerance)) return p;
    patterns.push_back(std::move(pattern));
    return patterns.size() - 1;
}

}  // namespace

double elapsed(const models::System& system, const Segment& segment, Index sample) {
    if (segment.times.size() > 0) return segment.times[sample] - segment.times[0];
    const double one = system.kind() == models::Kind::forced ? 2.0 * std::numbers::pi : 1.0;
    return one * static_cast<double>(sample);
}

ShootingPlan plan_shooting(const models::System& system, const Series& series, const std::vector<std::size_t>& segments,
                           const std::vector<ObservedCoordinate>& observed, const models::Sensor& sensor,
                           Index interval) {
    ShootingPlan plan;
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    const auto angle = static_cast<Index>(sensor.angle);
    const auto rate = static_cast<Index>(sensor.rate);
    const bool sections = series.sampling == Series::Sampling::section;
    if (sections && system.kind() == models::Kind::forced) plan.clock = models::Clock::phase;
    Index angle_row = -1;
    for (const ObservedCoordinate& o : observed)
        if (o.coordinate == angle) angle_row = o.row;
    for (const std::size_t s : segments) {
        const Segment& data = series.segments[s];
        const Index samples = data.values.cols();
        // Times of a section of a forced model are of no use: its phases are exact.
        const auto at = [&](Index k) {
            if (plan.clock == models::Clock::phase) return 2.0 * std::numbers::pi * static_cast<double>(k);
            return elapsed(system, data, k);
        };
        const double tolerance = samples > 1 ? same_instant * at(samples - 1) / static_cast<double>(samples - 1) : 0.0;
        for (Index first = 0; first < samples; first += interval) {
            const Index next = first + interval;
            PlannedNode node;
            node.segment = s;
            node.sample = first;
            node.first = plan.readings.size();
            node.linked = next < samples;
            InstantPattern pattern;
            pattern.input = system.inputs().empty() ? 0 : s;
            for (Index k = first; k < std::min(next, samples); ++k) {
                const double after = at(k) - at(first);
                const Index now = k > first ? std::ssize(pattern.instants) : -1;
                if (k > first) pattern.instants.push_back({after, false});
                const Index later = difference ? std::ssize(pattern.instants) : -1;
                if (difference) pattern.instants.push_back({after, true});
                for (const ObservedCoordinate& o : observed) {
                    PlannedReading reading{o.coordinate, now, k, data.values(o.row, k), 1.0, o.group};
                    if (difference && o.coordinate == rate)
                        reading = {angle, later,  k, data.values(angle_row, k) + sensor.delay * reading.value,
                                   1.0,   o.group};
                    if (!std::isfinite(reading.value)) continue;
                    if (o.known_sds) reading.deviation = data.deviations(o.row, k);
                    plan.readings.push_back(reading);
                }
            }
            if (node.linked) {
                pattern.match = std::ssize(pattern.instants);
                pattern.instants.push_back({at(next) - at(first), false});
            }
            node.count = plan.readings.size() - node.first;
            node.pattern = place(plan.patterns, std::move(pattern), tolerance);
            plan.patterns[node.pattern].nodes.push_back(plan.nodes.size());
            plan.nodes.push_back(node);
        }
    }
    return plan;
}

}  // namespace orbid::orbits
