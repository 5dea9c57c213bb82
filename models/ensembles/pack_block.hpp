#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "models/ensembles/pack_outcome.hpp"
#include "models/system/stopped.hpp"
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
          tables_(steps, coarsest),
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
                put(i, lanes_[i].section);
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
    using Lane = PackLane<n>;
    using Tables = PeriodTables<Steps>;
    using Outcome = PackOutcome;
    using Crossing = PackCrossing<n>;
    template <class P>
    using Unpacked = UnpackedPackStep<M, P>;

    void finish_period(std::size_t i) {
        Lane& lane = lanes_[i];
        if (lane.ended) return;
        for (std::size_t c = 0; c < n; ++c)
            lane.section[c] = steps_.model().coordinates[c].angle ? wrapped(x_[c][i]) : x_[c][i];
        std::size_t& columns = columns_[lane.trajectory];
        std::copy(lane.section.begin(), lane.section.end(), sections_[lane.trajectory] + columns * n);
        ++columns;
        lane.end_period(tables_[lane.level].count, Tables::finest);
    }

    void through_period(std::size_t first, std::size_t end, std::size_t level) {
        const PeriodSteps& steps = tables_[level];
        most_additional_ = 0;
        for (std::size_t k = 0; k < steps.count; ++k) {
            stop_if_asked(options_.interrupted);
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
            if (!halved_.empty()) halve(k, tables_[level + 2]);
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
        for (std::size_t c = 0; c < n; ++c)
            x[c] = count == P::width ? P::load(&x_[c][first])
                                     : gathered<P>(count, [&](std::size_t l) { return x_[c][first + l]; });
        return x;
    }
    void put(std::size_t i, const State<double, n>& x) {
        for (std::size_t c = 0; c < n; ++c)
            x_[c][i] = x[c];
    }
    /// One value per lane; lanes beyond count repeat the last.
    template <class P, class F>
    static P gathered(std::size_t count, const F& value) {
        std::array<double, P::width> lanes;
        for (std::size_t l = 0; l < P::width; ++l)
            lanes[l] = value(std::min(l, count - 1));
        return P::load(lanes.data());
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
                    put(i, lanes.at(lanes.end, l));
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
                x[c] = gathered<Narrow>(count, [&](std::size_t l) { return x_[c][halved_[first + l]]; });
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
                    put(i, other_half.at(other_half.end, l));
                } else {
                    general_.push_back(i);
                }
            }
        }
        halved_.clear();
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
            return gathered<Narrow>(count, [&](std::size_t l) { return all[l].*member; });
        };
        State<Narrow, n> x;
        for (std::size_t c = 0; c < n; ++c)
            x[c] = gathered<Narrow>(count, [&](std::size_t l) { return all[l].from[c]; });
        const Narrow s = each(&Crossing::s), length = each(&Crossing::length), side = Steps::side_of(x);
        const auto passage = steps_.through_surface(x, s, length, side, each(&Crossing::v1), each(&Crossing::moved),
                                                    each(&Crossing::first_rise), each(&Crossing::last_rise), until);
        const auto passed = passage.good.lanes();
        std::array<std::array<double, Narrow::width>, n> end;
        for (std::size_t c = 0; c < n; ++c)
            end[c] = passage.end[c].lanes();
        for (std::size_t l = 0; l < count; ++l) {
            const std::size_t i = all[l].lane;
            charge(i, 2);
            if (passed[l])
                put(i, Unpacked<Narrow>::at(end, l));
            else
                general_.push_back(i);
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
        Trajectory<M, 0> trajectory(p_, x, phase_, Clock::phase, options, nullptr, steps_.model());
        trajectory.restart(x, steps.start(k));
        const FlowStatus status = trajectory.advance(steps.end(k));
        charge(i, trajectory.steps());
        if (status != FlowStatus::ok) return finish(i, status);
        put(i, trajectory.state());
    }

    const Values<double, q>& p_;
    double phase_;
    const FlowOptions& options_;
    const Steps& steps_;
    Tables tables_;
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
