#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "models/ensembles/flow_lanes.hpp"
#include "models/system/stopped.hpp"

namespace orbid::models {

/// A step shared by all trajectories that began at the same phase.
template <class Steps>
struct SharedStep {
    double start, length, end;  ///< in units of the clock
    std::size_t reached;        ///< durations reached with it and before
    typename Steps::Forcing forcing;
};

/// Some of many flows over the same durations, advanced in packs with N directions of derivative.
///
/// Along shared steps all lanes use the same table of the forcing. Lanes whose step was rejected, or meets the
/// switching surface, go through it in packs of their own. There each lane has its own step length, controlled as in a
/// Trajectory, and crosses the surface where it comes. A step in which the crossing is not clearly located is halved.
/// Without shared steps all lanes go this way from one duration to the next. Cases that no pack can decide are computed
/// by a separate flow: a start on the surface, sticking, grazing, a state that is not finite, an exhausted step budget.
/// A trajectory depends on itself and the shared steps only, not on who shares its packs.
template <FlowPackModel M, std::size_t N, class Arch = xsimd::default_arch>
class FlowBlock {
public:
    using Steps = FlowSteps<M, N, Arch>;
    using P = typename Steps::P;
    using Numbers = typename Steps::Numbers;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t width = P::width;

    /// @param columns  which of the starts, any order
    FlowBlock(const Steps& steps, const FlowStarts& starts, std::span<const std::size_t> columns)
        : steps_(steps), options_(starts.options), lanes_(starts, columns) {}

    /// Through all durations; store(i, k) is called for every trajectory that gets there.
    template <class Store>
    void run(std::span<const double> durations, std::span<const SharedStep<Steps>> shared, const Store& store) {
        std::size_t k = 0;
        const auto arrive = [&](std::size_t reached) {
            for (; k < reached; ++k)
                for (std::size_t i = 0; i < lanes_.size(); ++i)
                    if (!lanes_[i].failed) store(i, k);
        };
        if (!shared.empty()) {
            for (const SharedStep<Steps>& step : shared) {
                arrive(step.reached);
                together(step);
            }
            arrive(durations.size());
            return;
        }
        double s = 0.0;
        while (k < durations.size()) {
            if (durations[k] > s) {
                for (std::size_t i = 0; i < lanes_.size(); ++i)
                    if (!lanes_[i].failed) walkers_.push_back({i, s, lanes_[i].length, lanes_.side_of(i)});
                walk(s = durations[k]);
            }
            arrive(k + 1);
        }
    }

    [[nodiscard]] std::size_t count() const { return lanes_.size(); }
    /// Computed by a separate flow.
    [[nodiscard]] bool failed(std::size_t i) const { return lanes_[i].failed; }
    [[nodiscard]] std::size_t steps(std::size_t i) const { return lanes_[i].steps; }
    [[nodiscard]] std::size_t crossings(std::size_t i) const { return lanes_[i].crossings; }
    /// Shared steps that were too coarse for their trajectory.
    [[nodiscard]] std::size_t coarse() const { return coarse_; }
    [[nodiscard]] double value(std::size_t i, std::size_t c) const { return lanes_.number(Steps::index(c, 0), i); }
    [[nodiscard]] double partial(std::size_t i, std::size_t c, std::size_t direction) const {
        return lanes_.number(Steps::index(c, 1 + direction), i);
    }

private:
    using Lanes = FlowLanes<M, N, Arch>;
    using Unpacked = typename Lanes::UnpackedStep;
    struct Walker {
        std::size_t lane;
        double s;
        double length;  ///< of the next step
        double side;
        double to_surface = 0.0;  ///< length of the step that ends close to the surface; 0: none
        double crossed = 0.0;     ///< length of the step in which it was met
        int rejected = 0;         ///< tries in a row
    };
    SpeedOverStep speed_of(const Unpacked& step, std::size_t l, std::size_t i, double side, double ds) const {
        return lanes_.speed_over(step, l, i, side, ds * steps_.field().seconds());
    }

    /// One shared step of all.
    void together(const SharedStep<Steps>& shared) {
        stop_if_asked(options_.interrupted);
        for (std::size_t first = 0; first < lanes_.size(); first += width) {
            const Numbers x = lanes_.load(first);
            P side(1.0);
            if constexpr (SwitchingModel<M>) side = copysign(side, x[Steps::index(n - 1, 0)]);
            typename Steps::Step step;
            steps_.step(x, P(0.0), P(shared.start), P(shared.length), side, &shared.forcing, step);
            auto smooth = step.ratio <= P(1.0);
            if constexpr (SwitchingModel<M>) {
                const P v0 = side * x[Steps::index(n - 1, 0)], v1 = side * step.end[Steps::index(n - 1, 0)];
                smooth = smooth & (v0 > P(0.0)) & (v1 > P(0.0)) &
                         ((side * step.first_rise >= P(0.0)) | (side * step.last_rise <= P(0.0)));
            }
            const std::size_t count = std::min(width, lanes_.size() - first);
            for (std::size_t i = first; i < first + count; ++i)
                ++lanes_[i].steps;
            if (smooth.all()) {
                lanes_.store(step.end, first);
                continue;
            }
            sort_out(Unpacked(step), first, count, shared);
        }
        if (!walkers_.empty()) walk(shared.end);
    }
    void sort_out(const Unpacked& step, std::size_t first, std::size_t count, const SharedStep<Steps>& shared) {
        for (std::size_t l = 0; l < count; ++l) {
            const std::size_t i = first + l;
            if (lanes_[i].failed) continue;
            Walker walker{i, shared.start, shared.length, lanes_.side_of(i)};
            if (!(step.ratio[l] <= 1.0)) {
                ++coarse_;
                walker.length *= shorter(step.ratio[l]);
                walkers_.push_back(walker);
                continue;
            }
            if constexpr (SwitchingModel<M>) {
                if (!(std::abs(lanes_.speed(i)) > 0.0)) {
                    lanes_[i].failed = true;
                    continue;
                }
                const SpeedOverStep v = speed_of(step, l, i, walker.side, shared.length);
                const SurfaceMeeting met = meeting_within(v);
                if (met == SurfaceMeeting::once) {
                    walker.to_surface = part_before_meeting(v) * shared.length;
                    walker.crossed = shared.length;
                } else if (met == SurfaceMeeting::unclear) {
                    walker.length *= 0.5;
                }
                if (met != SurfaceMeeting::none) {
                    walkers_.push_back(walker);
                    continue;
                }
            }
            lanes_.take(step.end, l, i);
        }
    }

    /// The estimate goes with the ninth power of the step. Safety 0.9, change at most 5 times, as in ControlledStep.
    static double factor(double ratio) {
        return ratio > 0.0 ? std::clamp(0.9 * std::pow(ratio, -1.0 / verner98.error_order), 0.2, 5.0) : 5.0;
    }
    static double shorter(double ratio) { return std::isfinite(ratio) ? std::min(factor(ratio), 0.9) : 0.25; }

    /// All walkers by steps of their own to s = target.
    void walk(double target) {
        std::array<Walker, width> active;
        std::size_t count = 0, next = 0;
        for (;;) {
            while (count < width && next < walkers_.size())
                active[count++] = walkers_[next++];
            if (count == 0) break;
            stride(active, count, target);
            for (std::size_t l = count; l-- > 0;)
                if (lanes_[active[l].lane].failed || !(active[l].s < target)) {
                    lanes_[active[l].lane].length = active[l].length;
                    active[l] = active[--count];
                }
        }
        walkers_.clear();
    }

    /// One number for each lane of a pack; those beyond the walkers repeat the last.
    template <class F>
    static P gathered(const std::array<Walker, width>& active, std::size_t count, const F& number) {
        typename Lanes::PerLane lanes;
        for (std::size_t l = 0; l < width; ++l)
            lanes[l] = number(active[std::min(l, count - 1)]);
        return P::load(lanes.data());
    }
    static double step_length(const Walker& walker, double target) {
        if (walker.to_surface > 0.0) return walker.to_surface;
        const double remaining = target - walker.s;
        // Two equal steps instead of a full one and a tiny rest; a rest of 1e-6 is included in the step.
        return walker.length >= remaining * (1.0 - 1e-6) ? remaining : std::min(walker.length, 0.5 * remaining);
    }

    /// One step of each of `count` walkers.
    void stride(std::array<Walker, width>& active, std::size_t count, double target) {
        stop_if_asked(options_.interrupted);
        Numbers x;
        for (std::size_t k = 0; k < Steps::size; ++k)
            x[k] = gathered(active, count, [&](const Walker& w) { return lanes_.number(k, w.lane); });
        const P phase = gathered(active, count, [&](const Walker& w) { return lanes_.phase(w.lane); });
        const P side = gathered(active, count, [](const Walker& w) { return w.side; });
        set_first_lengths(active, count, x, phase, side);
        const P s = gathered(active, count, [](const Walker& w) { return w.s; });
        const P ds = gathered(active, count, [&](const Walker& w) { return step_length(w, target); });
        typename Steps::Step step;
        steps_.step(x, phase, s, ds, side, nullptr, step);
        typename Lanes::UnpackedSurface surface;
        if constexpr (SwitchingModel<M>) {
            const auto meets = [](const Walker& w) { return w.to_surface > 0.0; };
            if (std::any_of(active.begin(), active.begin() + static_cast<std::ptrdiff_t>(count), meets)) {
                const P crossed = gathered(active, count, [](const Walker& w) { return w.crossed; });
                typename Steps::Surface found;
                steps_.pass(step.end, phase, s + ds, crossed, side, found);
                surface = {Lanes::unpacked(found.x), found.s.lanes(), found.close.lanes(), found.through.lanes()};
            }
        }
        settle(active, count, target, Unpacked(step), ds.lanes(), surface);
    }

    /// What becomes of the walkers after a step: on, once more and shorter, or through the surface.
    void settle(std::array<Walker, width>& active, std::size_t count, double target, const Unpacked& step,
                const typename Lanes::PerLane& ds, const typename Lanes::UnpackedSurface& surface) {
        for (std::size_t l = 0; l < count; ++l) {
            Walker& walker = active[l];
            auto& lane = lanes_[walker.lane];
            const double ratio = step.ratio[l];
            if (++lane.steps >= options_.maximum_steps) {
                lane.failed = true;
            } else if (!(ratio <= 1.0)) {
                shorten(walker, ds[l] * shorter(ratio));
            } else if (!(walker.to_surface > 0.0)) {
                accept(walker, step, l, ds[l], target);
            } else if (!surface.close[l]) {
                shorten(walker, 0.5 * walker.crossed);
            } else if (!surface.through[l]) {
                lane.failed = true;
            } else {
                lanes_.take(surface.x, l, walker.lane);
                walker.s = std::min(surface.s[l], target);
                walker.side = -walker.side;
                walker.to_surface = 0.0;
                ++lane.crossings;
            }
        }
    }
    /// Once more from the same place.
    void shorten(Walker& walker, double length) {
        walker.to_surface = 0.0;
        walker.length = length;
        // Give up after twenty tries in a row.
        lanes_[walker.lane].failed = ++walker.rejected == 20 || !(walker.s + length > walker.s);
    }
    void accept(Walker& walker, const Unpacked& step, std::size_t l, double ds, double target) {
        if constexpr (SwitchingModel<M>) {
            const SpeedOverStep v = speed_of(step, l, walker.lane, walker.side, ds);
            const SurfaceMeeting met = meeting_within(v);
            if (met == SurfaceMeeting::unclear) return shorten(walker, 0.5 * ds);
            if (met == SurfaceMeeting::once) {
                walker.to_surface = part_before_meeting(v) * ds;
                walker.crossed = ds;
                // The start is too close to the surface for any step to reach it.
                if (!(walker.s + walker.to_surface > walker.s)) lanes_[walker.lane].failed = true;
                return;
            }
        }
        lanes_.take(step.end, l, walker.lane);
        walker.s = ds == target - walker.s ? target : walker.s + ds;
        walker.rejected = 0;
        const double next = ds * factor(step.ratio[l]);
        // A step shortened to end at a target must not shorten the next one.
        walker.length = ds < walker.length ? std::max(walker.length, next) : next;
    }

    /// A twentieth of the forcing's period, or the time in which the state changes by its own size, times the ninth
    /// root of the tolerance. The first error estimate corrects it.
    void set_first_lengths(std::array<Walker, width>& active, std::size_t count, const Numbers& x, const P& phase,
                           const P& side) const {
        bool all = true;
        for (std::size_t l = 0; l < count; ++l)
            all = all && active[l].length > 0.0;
        if (all) return;
        const auto rate = steps_.rate_of_change(x, phase, side).lanes();
        const double part = 2.0 * std::pow(options_.relative_tolerance, 1.0 / verner98.error_order);
        for (std::size_t l = 0; l < count; ++l)
            if (!(active[l].length > 0.0))
                active[l].length = std::isfinite(rate[l]) && rate[l] > 0.0 ? part / rate[l] : 0.01;
    }

    const Steps& steps_;
    const FlowOptions& options_;
    Lanes lanes_;
    std::vector<Walker> walkers_;
    std::size_t coarse_ = 0;
};

}  // namespace orbid::models
