#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/ensembles/flow_steps.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// What one step tells about the velocity along its side, which is > 0 until the switching surface is met.
struct SpeedOverStep {
    double v0, v1;                 ///< at its ends
    double first_rise, last_rise;  ///< acceleration there times duration
    double moved;                  ///< mean: way of the position over duration
};
enum class SurfaceMeeting { none, once, unclear };

[[nodiscard]] inline SurfaceMeeting meeting_within(const SpeedOverStep& v) {
    if (v.v1 < 0.0 && v.v0 > 0.0) return SurfaceMeeting::once;
    if (!(v.v1 > 0.0)) return SurfaceMeeting::unclear;
    // Slower in between than at both ends: two crossings may hide in the step. The tangents bound the dip of a convex
    // curve. A dip is accepted only if it stays above half of the smaller end.
    if (!(v.first_rise < 0.0 && v.last_rise > 0.0)) return SurfaceMeeting::none;
    const double meet = std::clamp((v.v1 - v.v0 - v.last_rise) / (v.first_rise - v.last_rise), 0.0, 1.0);
    return v.v0 + v.first_rise * meet > 0.5 * std::min(v.v0, v.v1) ? SurfaceMeeting::none : SurfaceMeeting::unclear;
}

/// The fraction of the step after which a surface that is met once is met: a guess.
[[nodiscard]] inline double part_before_meeting(const SpeedOverStep& v) {
    return quartic_zero(v.v0, v.v1, v.first_rise, v.last_rise, v.moved);
}

/// Where the trajectories of a FlowBlock are, and how they got there.
template <FlowPackModel M, std::size_t N, class Arch>
class FlowLanes {
public:
    using Steps = FlowSteps<M, N, Arch>;
    using P = typename Steps::P;
    using Numbers = typename Steps::Numbers;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t width = P::width;
    /// One number per lane of a pack.
    using PerLane = std::array<double, width>;

    struct Lane {
        bool failed = false;
        std::size_t steps = 0;
        std::size_t crossings = 0;
        double length = 0.0;  ///< of the next step of its own; 0: not known yet
    };

    /// @param columns  which of the starts, any order
    FlowLanes(const FlowStarts& starts, std::span<const std::size_t> columns) : lanes_(columns.size()) {
        const std::size_t padded = (lanes_.size() + width - 1) / width * width;
        for (auto& component : x_)
            component.assign(padded, 0.0);
        phase_.assign(padded, 0.0);
        for (std::size_t i = 0; i < padded; ++i) {
            // Lanes without a trajectory repeat the last.
            const std::size_t column = columns[std::min(i, lanes_.size() - 1)];
            for (std::size_t c = 0; c < n; ++c) {
                x_[Steps::index(c, 0)][i] = starts.states[column * n + c];
                x_[Steps::index(c, 1 + c)][i] = 1.0;
            }
            phase_[i] = starts.phases[column];
        }
        for (std::size_t i = 0; i < lanes_.size(); ++i)
            if constexpr (SwitchingModel<M>) lanes_[i].failed = !(std::abs(speed(i)) > 0.0);
    }

    [[nodiscard]] std::size_t size() const { return lanes_.size(); }
    [[nodiscard]] Lane& operator[](std::size_t i) { return lanes_[i]; }
    [[nodiscard]] const Lane& operator[](std::size_t i) const { return lanes_[i]; }
    [[nodiscard]] double phase(std::size_t i) const { return phase_[i]; }
    /// Number k of a lane, see FlowField::index.
    [[nodiscard]] double number(std::size_t k, std::size_t i) const { return x_[k][i]; }
    [[nodiscard]] double speed(std::size_t i) const { return x_[Steps::index(n - 1, 0)][i]; }
    [[nodiscard]] double side_of([[maybe_unused]] std::size_t i) const {
        if constexpr (SwitchingModel<M>)
            return speed(i) < 0.0 ? -1.0 : 1.0;
        else
            return 1.0;
    }

    /// A whole pack of lanes from `first` on.
    [[nodiscard]] Numbers load(std::size_t first) const {
        Numbers x;
        for (std::size_t k = 0; k < Steps::size; ++k)
            x[k] = P::load(&x_[k][first]);
        return x;
    }
    void store(const Numbers& x, std::size_t first) {
        for (std::size_t k = 0; k < Steps::size; ++k)
            x[k].store(&x_[k][first]);
    }

    /// Numbers of a pack, lane by lane.
    using Unpacked = std::array<PerLane, Steps::size>;
    static Unpacked unpacked(const Numbers& x) {
        Unpacked lanes;
        for (std::size_t k = 0; k < Steps::size; ++k)
            lanes[k] = x[k].lanes();
        return lanes;
    }
    /// Steps of a pack, lane by lane.
    struct UnpackedStep {
        Unpacked end;
        PerLane ratio, first_rise, last_rise;
        explicit UnpackedStep(const typename Steps::Step& step) : end(unpacked(step.end)), ratio(step.ratio.lanes()) {
            if constexpr (SwitchingModel<M>) {
                first_rise = step.first_rise.lanes();
                last_rise = step.last_rise.lanes();
            }
        }
    };
    /// Passages through the switching surface, lane by lane; without one, nothing is close and x undefined.
    struct UnpackedSurface {
        Unpacked x;
        PerLane s{};
        std::array<bool, width> close{}, through{};
    };
    /// Lane i goes to what stands in lane l of a pack.
    void take(const Unpacked& end, std::size_t l, std::size_t i) {
        for (std::size_t k = 0; k < Steps::size; ++k)
            x_[k][i] = end[k][l];
    }
    /// @param duration  of the step [s]
    [[nodiscard]] SpeedOverStep speed_over(const UnpackedStep& step, std::size_t l, std::size_t i, double side,
                                           double duration) const {
        const double moved = step.end[Steps::index(0, 0)][l] - x_[Steps::index(0, 0)][i];
        return {side * speed(i), side * step.end[Steps::index(n - 1, 0)][l], side * step.first_rise[l],
                side * step.last_rise[l], side * moved / duration};
    }

private:
    std::vector<Lane> lanes_;
    std::array<std::vector<double>, Steps::size> x_;  ///< values and partials of the lanes
    std::vector<double> phase_;
};

}  // namespace orbid::models
