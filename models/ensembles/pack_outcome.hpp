#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "models/ensembles/pack_steps.hpp"

namespace orbid::models {

/// What becomes of a lane of a pack after a step.
enum class PackOutcome { smooth, coarse, crosses, other };

/// One of the trajectories that are advanced through whole periods together.
template <std::size_t n>
struct PackLane {
    std::size_t trajectory;
    State<double, n> section;    ///< state at the last section
    std::size_t level = 0;       ///< of the table whose steps it takes, see PeriodTables
    std::size_t halved = 0;      ///< rejected steps of this period
    std::size_t calm = 0;        ///< periods without such steps at this level
    std::size_t additional = 0;  ///< steps of this period beside those of the table
    bool ended = false;

    /// Chooses the level for the next period.
    /// @param count  steps of the present table
    void end_period(std::size_t count, std::size_t finest) {
        // A halved step costs about four times one of the table: from an eighth of them on a finer table is cheaper.
        // After eight periods without one, the coarser table is tried again.
        if (8 * halved > count) {
            level = std::min(level + 1, finest);
            calm = 0;
        } else if (halved > 0) {
            calm = 0;
        } else if (++calm == 8 && level > 0) {
            --level;
            calm = 0;
        }
        halved = 0;
        additional = 0;
    }
};

/// A step of which the velocity changes its sign.
template <std::size_t n>
struct PackCrossing {
    std::size_t lane;
    State<double, n> from;
    double s, length;              ///< start and length of the step [rad]
    double v1, moved;              ///< velocity at its end, way of the position
    double first_rise, last_rise;  ///< accelerations times duration
};

/// A step of a pack, lane by lane.
template <ForcedModel M, class P>
struct UnpackedPackStep {
    static constexpr std::size_t n = dimension_of<M>;
    std::array<bool, P::width> kept, same_side;
    std::array<std::array<double, P::width>, n> start, end;
    std::array<double, P::width> first_rise, last_rise;

    UnpackedPackStep(const PackStep<P, n>& step, const State<P, n>& x) : kept(step.kept.lanes()) {
        for (std::size_t c = 0; c < n; ++c) {
            start[c] = x[c].lanes();
            end[c] = step.end[c].lanes();
        }
        if constexpr (SwitchingModel<M>) {
            same_side = step.same_side.lanes();
            first_rise = step.first_rise.lanes();
            last_rise = step.last_rise.lanes();
        }
    }
    [[nodiscard]] PackOutcome outcome(std::size_t l) const {
        if constexpr (SwitchingModel<M>) {
            if (start[velocity][l] == 0.0) return PackOutcome::other;
            if (!kept[l]) return PackOutcome::coarse;
            if (same_side[l]) return PackOutcome::smooth;
            return (start[velocity][l] > 0.0) != (end[velocity][l] > 0.0) && end[velocity][l] != 0.0
                       ? PackOutcome::crosses
                       : PackOutcome::other;
        } else {
            return kept[l] ? PackOutcome::smooth : PackOutcome::coarse;
        }
    }
    [[nodiscard]] PackCrossing<n> crossing(std::size_t l, std::size_t lane, double s, double length) const {
        return {lane, at(start, l), s, length, end[n - 1][l], end[0][l] - start[0][l], first_rise[l], last_rise[l]};
    }
    /// The state of lane l.
    static State<double, n> at(const std::array<std::array<double, P::width>, n>& lanes, std::size_t l) {
        State<double, n> x;
        for (std::size_t c = 0; c < n; ++c)
            x[c] = lanes[c][l];
        return x;
    }
};

}  // namespace orbid::models
