#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// A reading that a node predicts.
struct PlannedReading {
    Eigen::Index coordinate = 0;  ///< of the model
    Eigen::Index instant = -1;    ///< index into the pattern's instants; -1: at the node itself
    Eigen::Index sample = 0;      ///< column of the segment
    double value = 0.0;
    double deviation = 1.0;  ///< known sd, 1 where none is
    int group = 0;
};

/// An instant after a node, on the clock of the flow; if `delayed`, plus the delay [s] of a difference sensor.
struct Instant {
    double after = 0.0;
    bool delayed = false;
};

/// The instants that the flow from a node must reach; nodes with equal instants share a pattern.
struct InstantPattern {
    std::vector<Instant> instants;
    std::ptrdiff_t match = -1;       ///< of the next node; -1: none
    std::size_t input = 0;           ///< segment whose measured inputs drive the flow; 0 without inputs
    std::vector<std::size_t> nodes;  ///< ascending
};

/// One node of a trajectory: the state at a sample.
struct PlannedNode {
    std::size_t segment = 0;
    Eigen::Index sample = 0;  ///< column of the segment
    std::size_t pattern = 0;
    std::size_t first = 0;  ///< readings [first, first + count) of the plan
    std::size_t count = 0;
    bool linked = false;  ///< another node of the same segment follows
};

/// What is read from the segments of a series.
struct ObservedCoordinate {
    Eigen::Index row = 0;         ///< of segment.values
    Eigen::Index coordinate = 0;  ///< of the model
    int group = 0;
    bool known_sds = false;  ///< Segment::deviations are used
};

/// The nodes of all fitted segments in order, their readings, and which of them can be simulated together.
struct ShootingPlan {
    std::vector<PlannedNode> nodes;
    std::vector<PlannedReading> readings;
    std::vector<InstantPattern> patterns;
    models::Clock clock = models::Clock::time;

    [[nodiscard]] std::span<const PlannedReading> of(std::size_t node) const {
        return {readings.data() + nodes[node].first, nodes[node].count};
    }
};

/// Nodes every `interval` samples, each with the samples up to the next; the last node of a segment has the rest. For
/// an angle_difference sensor the readings are the angle and the angle `delay` later (reading + delay quotient). The
/// rate has no record of its own.
///
/// Instants of nodes are equal within 1e-10 of a sampling interval, so that rounded times make no patterns of their
/// own.
[[nodiscard]] ShootingPlan plan_shooting(const models::System& system, const Series& series,
                                         const std::vector<std::size_t>& segments,
                                         const std::vector<ObservedCoordinate>& observed, const models::Sensor& sensor,
                                         Eigen::Index interval);

/// Time from the first to the given sample on the clock of a plan; sections and iterations are equidistant.
[[nodiscard]] double elapsed(const models::System& system, const Segment& segment, Eigen::Index sample);

}  // namespace orbid::orbits

#pragma GCC visibility pop
