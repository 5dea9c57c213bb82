#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>
#include <vector>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/ensembles/pack_steps.hpp"
#include "models/trajectories/flow.hpp"
#include "models/trajectories/trajectory.hpp"

namespace orbid::models {

/// A block of trajectories of a forced model, advanced through whole periods in packs.
///
/// All lanes take the steps of the period's table together. After each step the lanes that were rejected, or met the
/// switching surface, are picked out of the whole block. They repeat the step in packs of their own with steps of their
/// own length:
///
///     tolerance not kept    two half steps
///     one crossing          a step to where a quartic through the ends of the step puts it, a correction to where
///                           the velocity is zero, a step on the other side to the end
///     all else              (two crossings in a step, sticking, grazing, a start on the surface, a tolerance not kept
///                           by half steps) a Trajectory, which refines and sticks
///
/// So the error control is that of a flow. Each trajectory depends on itself alone: results are the same bytes whatever
/// else is in the block, in whatever order.
template <PackModel M, class Arch = xsimd::default_arch>
class PackBlock {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    using Steps = PackSteps<M, Arch>;
    using Wide = typename Steps::Wide;
    using Narrow = typename Steps::Narrow;

    /// @param starts    n x count, column-major
    /// @param sections  per trajectory n x (periods + 1), column 0 = start
    /// @param columns   per trajectory: columns of `sections` that are valid
    PackBlock(const Values<double, q>& p, double phase, const FlowOptions& options, const Steps& steps,
              const PeriodSteps& coarsest, const double* starts, std::size_t count, double* const* sections,
              std::size_t* columns, FlowStatus* status)
        : p_(p),
          phase_(phase),
          options_(options),
          steps_(steps),
          coarsest_(coarsest),
          sections_(sections),
          columns_(columns),
          status_(status) {
        lanes_.reserve(count);
        for (std::size_t i = 0; i < count; ++i) {
            std::copy(starts + i * n, starts + (i + 1) * n, sections[i]);
            columns[i] = 1;
            status[i] = FlowStatus::ok;
            lanes_.push_back({i, array_from<double, n>(starts + i * n)});
        }
        for (auto& component : x_)
            component.resize(count);
    }

    void advance(std::size_t periods) {
        for (std::size_t period = 1; period <= periods && !lanes_.empty(); ++period) {
            // Lanes of one level stand side by side, so that they share packs.
            std::stable_sort(lanes_.begin(), lanes_.end(),
                             [](const Lane& a, const Lane& b) { return a.level < b.level; });
            for (std::size_t i = 0; i < lanes_.size(); ++i)
                for (std::size_t c = 0; c < n; ++c)
                    x_[c][i] = lanes_[i].section[c];
            for (std::size_t first = 0; first < lanes_.size();) {
                std::size_t end = first;
                while (end < lanes_.size() && lanes_[end].level == lanes_[first].level)
                    ++end;
                through_period(first, end, lanes_[first].level);
                first = end;
            }
            for (std::size_t i = 0; i < lanes_.size(); ++i)
                finish_period(i);
            lanes_.erase(std::remove_if(lanes_.begin(), lanes_.end(), [](const Lane& lane) { return lane.ended; }),
                         lanes_.end());
        }
    }

private:
    struct Lane {
        std::size_t trajectory;
        State<double, n> section;    ///< state at the last section
        std::size_t level = 0;       ///< the period's table has 2^level times the coarsest one's steps
        std::size_t halved = 0;      ///< rejected steps of this period
        std::size_t calm = 0;        ///< periods without such steps at this level
        std::size_t additional = 0;  ///< steps of this period beside those of the table
        bool ended = false;
    };
    /// A step of which the velocity changes its sign.
    struct Crossing {
        std::size_t lane;
        State<double, n> from;
        double s, length;              ///< start and length of the step [rad]
        double v1, moved;              ///< velocity at its end, way of the position
        double first_rise, last_rise;  ///< accelerations times duration
    };

    /// Refinement by 2^5 at most: beyond that, steps of free length are better.
    static constexpr std::size_t finest = 10;
    /// The table of a level: 2^(level/2) times the coarsest one's steps; two levels double it exactly.
    const PeriodSteps& period_at(std::size_t level) {
        if (level == 0) return coarsest_;
        std::optional<PeriodSteps>& period = finer_[level - 1];
        if (!period) {
            const auto odd =
                static_cast<std::size_t>(std::lround(std::numbers::sqrt2 * static_cast<double>(coarsest_.count)));
            period = steps_.period_in((level % 2 == 0 ? coarsest_.count : odd) << (level / 2));
        }
        return *period;
    }

    void finish_period(std::size_t i) {
        Lane& lane = lanes_[i];
        if (lane.ended) return;
        for (std::size_t c = 0; c < n; ++c)
            lane.section[c] = M::coordinates[c].angle ? wrapped(x_[c][i]) : x_[c][i];
        std::size_t& columns = columns_[lane.trajectory];
        std::copy(lane.section.begin(), lane.section.end(), sections_[lane.trajectory] + columns * n);
        ++columns;
        // A halved step costs about four times one of the table: from an eighth of them on a finer table is cheaper.
        // After eight periods without one, the coarser table is tried again.
        if (8 * lane.halved > period_at(lane.level).count) {
            lane.level = std::min(lane.level + 1, finest);
            lane.calm = 0;
        } else if (lane.halved > 0) {
            lane.calm = 0;
        } else if (++lane.calm == 8 && lane.level > 0) {
            --lane.level;
            lane.calm = 0;
        }
        lane.halved = 0;
        lane.additional = 0;
    }

    void through_period(std::size_t first, std::size_t end, std::size_t level) {
        const PeriodSteps& steps = period_at(level);
        most_additional_ = 0;
        for (std::size_t k = 0; k < steps.count; ++k) {
            if (k + most_additional_ >= options_.maximum_steps) {
                bool some = false;
                for (std::size_t i = first; i < end; ++i) {
                    if (!lanes_[i].ended && k + lanes_[i].additional >= options_.maximum_steps)
                        finish(i, FlowStatus::step_budget);
                    some = some || !lanes_[i].ended;
                }
                if (!some) return;
            }
            std::size_t i = first;
            // A wide pack takes about the time of two narrow ones, so it pays for more than one.
            for (; i + Wide::width <= end; i += Wide::width)
                step<Wide>(steps, k, i, Wide::width);
            if (i + Narrow::width < end)
                step<Wide>(steps, k, i, end - i);
            else if (i < end)
                step<Narrow>(steps, k, i, end - i);
            if (!halved_.empty()) halve(k, period_at(level + 2));
            cross(k, steps);
            for (const std::size_t lane : general_)
                follow(lane, k, steps);
            general_.clear();
        }
    }

    void finish(std::size_t i, FlowStatus status) {
        lanes_[i].ended = true;
        status_[lanes_[i].trajectory] = status;
    }

    template <class P>
    State<P, n> load(std::size_t first, std::size_t count) const {
        State<P, n> x;
        for (std::size_t c = 0; c < n; ++c) {
            if (count == P::width) {
                x[c] = P::load(&x_[c][first]);
            } else {
                std::array<double, P::width> lanes;
                for (std::size_t l = 0; l < P::width; ++l)
                    lanes[l] = x_[c][first + std::min(l, count - 1)];
                x[c] = P::load(lanes.data());
            }
        }
        return x;
    }

    /// The step k of `count` lanes, at most a pack.
    template <class P>
    void step(const PeriodSteps& steps, std::size_t k, std::size_t first, std::size_t count) {
        const State<P, n> x = load<P>(first, count);
        const PackStep<P, n> step = steps_.tabulated(steps, k, x);
        bool smooth = step.kept.all();
        if constexpr (SwitchingModel<M>) smooth = smooth && step.same_side.all();
        if (smooth && count == P::width) {
            for (std::size_t c = 0; c < n; ++c)
                step.end[c].store(&x_[c][first]);
            return;
        }
        sort_out(step, x, first, count, steps.start(k), steps.length);
    }

    /// Classifies the lanes of a pack in which at least one step was rejected.
    template <class P>
    void sort_out(const PackStep<P, n>& step, const State<P, n>& x, std::size_t first, std::size_t count, double s,
                  double length) {
        const Unpacked<P> lanes(step, x);
        for (std::size_t l = 0; l < count; ++l) {
            const std::size_t i = first + l;
            if (lanes_[i].ended) continue;
            switch (lanes.outcome(l)) {
                case Outcome::smooth:
                    for (std::size_t c = 0; c < n; ++c)
                        x_[c][i] = lanes.end[c][l];
                    break;
                case Outcome::coarse:
                    halved_.push_back(i);
                    break;
                case Outcome::crosses:
                    crossings_.push_back(lanes.crossing(l, i, s, length));
                    break;
                case Outcome::other:
                    general_.push_back(i);
                    break;
            }
        }
    }

    enum class Outcome { smooth, coarse, crosses, other };
    template <class P>
    struct Unpacked {
        std::array<bool, P::width> kept, same_side;
        std::array<std::array<double, P::width>, n> start, end;
        std::array<double, P::width> first_rise, last_rise;

        Unpacked(const PackStep<P, n>& step, const State<P, n>& x) : kept(step.kept.lanes()) {
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
        [[nodiscard]] Outcome outcome(std::size_t l) const {
            if constexpr (SwitchingModel<M>) {
                if (start[velocity][l] == 0.0) return Outcome::other;
                if (!kept[l]) return Outcome::coarse;
                if (same_side[l]) return Outcome::smooth;
                return (start[velocity][l] > 0.0) != (end[velocity][l] > 0.0) && end[velocity][l] != 0.0
                           ? Outcome::crosses
                           : Outcome::other;
            } else {
                return kept[l] ? Outcome::smooth : Outcome::coarse;
            }
        }
        [[nodiscard]] Crossing crossing(std::size_t l, std::size_t lane, double s, double length) const {
            Crossing crossing{lane, {}, s, length, end[n - 1][l], end[0][l] - start[0][l], first_rise[l], last_rise[l]};
            for (std::size_t c = 0; c < n; ++c)
                crossing.from[c] = start[c][l];
            return crossing;
        }
    };

    void charge(std::size_t i, std::size_t steps) {
        lanes_[i].additional += steps;
        most_additional_ = std::max(most_additional_, lanes_[i].additional);
    }

    /// Rejected steps, repeated in two halves from the finer table.
    void halve(std::size_t k, const PeriodSteps& halves) {
        for (std::size_t first = 0; first < halved_.size(); first += Narrow::width) {
            const std::size_t count = std::min(Narrow::width, halved_.size() - first);
            State<Narrow, n> x;
            for (std::size_t c = 0; c < n; ++c)
                x[c] = gathered(count, [&](std::size_t l) { return x_[c][halved_[first + l]]; });
            const auto one = steps_.tabulated(halves, 2 * k, x);
            const auto two = steps_.tabulated(halves, 2 * k + 1, one.end);
            const Unpacked<Narrow> half(one, x), other_half(two, one.end);
            for (std::size_t l = 0; l < count; ++l) {
                const std::size_t i = halved_[first + l];
                ++lanes_[i].halved;
                charge(i, 2);
                const Outcome outcome = half.outcome(l);
                const Outcome then = outcome == Outcome::smooth ? other_half.outcome(l) : outcome;
                if (outcome == Outcome::crosses) {
                    crossings_.push_back(half.crossing(l, i, halves.start(2 * k), halves.length));
                } else if (then == Outcome::crosses) {
                    crossings_.push_back(other_half.crossing(l, i, halves.start(2 * k + 1), halves.length));
                } else if (then == Outcome::smooth) {
                    for (std::size_t c = 0; c < n; ++c)
                        x_[c][i] = other_half.end[c][l];
                } else {
                    general_.push_back(i);
                }
            }
        }
        halved_.clear();
    }

    /// One value per lane; lanes beyond count repeat the last.
    template <class F>
    static Narrow gathered(std::size_t count, const F& value) {
        std::array<double, Narrow::width> lanes;
        for (std::size_t l = 0; l < Narrow::width; ++l)
            lanes[l] = value(std::min(l, count - 1));
        return Narrow::load(lanes.data());
    }

    /// Steps in which the velocity changes its sign once: to the surface and on from there.
    void cross([[maybe_unused]] std::size_t k, [[maybe_unused]] const PeriodSteps& steps) {
        if constexpr (SwitchingModel<M>) {
            for (std::size_t first = 0; first < crossings_.size(); first += Narrow::width)
                cross(first, std::min(Narrow::width, crossings_.size() - first), steps.end(k));
            crossings_.clear();
        }
    }
    void cross(std::size_t first, std::size_t count, double until) requires SwitchingModel<M> {
        const Crossing* all = crossings_.data() + first;
        const auto each = [&](double Crossing::*member) {
            return gathered(count, [&](std::size_t l) { return all[l].*member; });
        };
        State<Narrow, n> x;
        for (std::size_t c = 0; c < n; ++c)
            x[c] = gathered(count, [&](std::size_t l) { return all[l].from[c]; });
        const Narrow s = each(&Crossing::s), length = each(&Crossing::length), side = Steps::side_of(x);
        const Narrow integral = each(&Crossing::moved) * steps_.omega() / length;
        const Narrow guess = quartic_zero(x[velocity], each(&Crossing::v1), each(&Crossing::first_rise),
                                          each(&Crossing::last_rise), integral);
        const auto to = steps_.free(x, s, guess * length, side);
        // From there to the zero of the velocity by the midpoint rule, with the step that makes it zero. The distance
        // is the error of the guess. Its cube is below all tolerances as long as it is less than 1e-4 of the step.
        const Narrow near = s + guess * length;
        const State<Narrow, n> f = steps_.slope(to.end, near, side);
        const Narrow about = -to.end[velocity] / f[velocity];
        State<Narrow, n> between;
        for (std::size_t c = 0; c < n; ++c)
            between[c] = to.end[c] + 0.5 * about * f[c];
        const State<Narrow, n> g = steps_.slope(between, near + 0.5 * steps_.omega() * about, side);
        const Narrow correction = -to.end[velocity] / g[velocity];
        State<Narrow, n> surface{to.end[0] + correction * g[0], Narrow(0.0)};
        const Narrow at = min(near + steps_.omega() * correction, Narrow(until));
        auto good = to.kept & (abs(correction) * steps_.omega() <= 1e-4 * length);
        // Crossed, neither held nor grazing. The accelerations of both sides point across, and clearly so where they
        // differ (1e-6 of the jump; a Trajectory decides closer cases).
        const Narrow arriving = side * steps_.slope(surface, at, side)[velocity];
        const Narrow leaving = side * steps_.slope(surface, at, -side)[velocity];
        const Narrow margin = 1e-6 * abs(leaving - arriving);
        good = good & (arriving < -margin) & (leaving < -margin);
        const auto on = steps_.free(surface, at, Narrow(until) - at, -side);
        good = good & on.kept & (side * on.end[velocity] < Narrow(0.0));
        const auto passed = good.lanes();
        std::array<std::array<double, Narrow::width>, n> end;
        for (std::size_t c = 0; c < n; ++c)
            end[c] = on.end[c].lanes();
        for (std::size_t l = 0; l < count; ++l) {
            const std::size_t i = all[l].lane;
            charge(i, 2);
            if (!passed[l]) {
                general_.push_back(i);
                continue;
            }
            for (std::size_t c = 0; c < n; ++c)
                x_[c][i] = end[c][l];
        }
    }

    /// The step k of one lane by a new trajectory. A reused one would remember steps of other lanes.
    void follow(std::size_t i, std::size_t k, const PeriodSteps& steps) {
        const std::size_t taken = k + lanes_[i].additional;
        FlowOptions options = options_;
        options.maximum_steps = options_.maximum_steps - std::min(options_.maximum_steps, taken);
        State<double, n> x;
        for (std::size_t c = 0; c < n; ++c)
            x[c] = x_[c][i];
        Trajectory<M, 0> trajectory(p_, x, phase_, Clock::phase, options);
        trajectory.restart(x, steps.start(k));
        const FlowStatus status = trajectory.advance(steps.end(k));
        charge(i, trajectory.steps());
        if (status != FlowStatus::ok) return finish(i, status);
        for (std::size_t c = 0; c < n; ++c)
            x_[c][i] = trajectory.state()[c];
    }

    const Values<double, q>& p_;
    double phase_;
    const FlowOptions& options_;
    const Steps& steps_;
    const PeriodSteps& coarsest_;
    std::array<std::optional<PeriodSteps>, finest + 2> finer_;  ///< halved steps are two levels up
    double* const* sections_;
    std::size_t* columns_;
    FlowStatus* status_;
    std::vector<Lane> lanes_;
    std::array<std::vector<double>, n> x_;  ///< states of the lanes
    std::size_t most_additional_ = 0;
    std::vector<std::size_t> halved_;  ///< lanes whose step was too coarse
    std::vector<Crossing> crossings_;
    std::vector<std::size_t> general_;  ///< lanes for a Trajectory
};

}  // namespace orbid::models
