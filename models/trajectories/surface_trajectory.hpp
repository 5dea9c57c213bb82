#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>

#include "models/trajectories/controlled_step.hpp"
#include "models/trajectories/input_knots.hpp"
#include "models/trajectories/surface_event.hpp"
#include "models/trajectories/surface_watch.hpp"

namespace orbid::models {

/// One solution of a model with switching surfaces, with N directions of derivative: the counterpart of Trajectory.
///
/// Crossings of every surface are located to machine accuracy and passed by (M5). Where both one-sided fields point at
/// a surface, the solution slides along it until one of them turns away; at impacts the state jumps. As in Trajectory,
/// decisions depend on the values and the derivatives with respect to the start only.
///
/// Named outcomes: grazing, where a surface is touched without crossing it, an impact does not send the state away, or
/// impacts accumulate at an instant. held_twice, where two surfaces hold the solution at once. When impacts accumulate
/// (a ball that comes to rest), `s` and `state` are those of the accumulation. Endless chattering between two surfaces
/// exhausts the step budget.
template <SurfaceModel M, std::size_t N, std::size_t order = 1>
class SurfaceTrajectory {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t m = surface_count_of<M>;
    using Point = State<T, n>;

    /// @param p      parameters, with partials in the directions that are asked for
    /// @param input  of an InputModel
    SurfaceTrajectory(const Values<T, parameter_count_of<M>>& p, const Point& x0, double phase, Clock clock,
                      const FlowOptions& options, const InputSignal* input = nullptr, const M& model = M())
        : walk_(SurfaceField<M, N, order>(p, phase, clock, model), options),
          values_(values_of<N, parameter_count_of<M>>(p), phase, clock, model),
          options_(options) {
        if constexpr (InputModel<M>) {
            knots_.emplace(*input, phase);
            walk_.altered_field().input = values_.input = input;
        }
        restart(x0);
        walk_.set_length(walk_.first_length());
        // Forcing that moves a surface, and nothing else, does not limit the length of steps.
        if constexpr (ForcedModel<M>) {
            const double period = 2.0 * std::numbers::pi;
            longest_ = (clock == Clock::phase ? period : period / value_of(values_.omega)) / 8.0;
            walk_.limit_length(longest_);
        }
    }

    /// A new start at s. The step size is kept, as the next piece of the same solution will need a similar one.
    void restart(const Point& x0, double s = 0.0) {
        walk_.restart(x0, s);
        if constexpr (InputModel<M>) {
            knots_->enter(s);
            set_piece();
        }
        const auto h = values_.surfaces(values_of<N, n>(x0), s);
        Side<M> side;
        on_.fill(false);
        begun_.fill(false);
        for (std::size_t j = 0; j < m; ++j) {
            side[j] = h[j] < 0.0 && !impacts[j] ? -1.0 : 1.0;
            on_[j] = h[j] == 0.0 && !impacts[j];
        }
        turn_to(side, m);
        last_impact_.fill(-std::numeric_limits<double>::infinity());
    }

    /// Replaces options.maximum_steps: all steps taken so far count.
    void limit_steps(std::size_t maximum) { walk_.limit_steps(maximum); }

    /// Moves on to s = target (not before the present s).
    [[nodiscard]] FlowStatus advance(double target) {
        FlowStatus status = FlowStatus::ok;
        while (s() < target && status == FlowStatus::ok)
            status = step_towards(target);
        return status;
    }

    /// Moves on by one accepted step, at most to s = target (behind the present s). It is shorter when a surface is
    /// met, where it ends just behind it (or held by it, or reset), and at the instants of a measured input.
    [[nodiscard]] FlowStatus step_towards(double target) {
        // A surface may turn around any number of times within a step of a constant solution. If it does not look
        // smooth on 2^-30 of a step either, it is noise.
        constexpr int shortest = 30;
        for (int shortened = 0;;) {
            if (on_surface()) {
                if (const FlowStatus status = leave_surfaces(); status != FlowStatus::ok) return status;
                pull_back();
            }
            double until = target;
            if constexpr (InputModel<M>) {
                if (!knots_->proceed(s(), target)) return FlowStatus::no_input;
                until = knots_->until();
                set_piece();
            }
            const FlowStatus status = walk_.attempt(until);
            if (status != FlowStatus::ok) return status;
            const double length = walk_.attempted();
            const auto outcome =
                watch_.first_event(values_,
                                   {s(), length, values_of<N, n>(walk_.state()), values_of<N, n>(walk_.slope()),
                                    values_of<N, n>(walk_.end()), values_of<N, n>(walk_.end_slope())},
                                   begun_, shortened < shortest);
            if (outcome.too_long) {
                ++shortened;
                walk_.limit_length(0.5 * length);
                limited_ = 0.5 * length;
                continue;
            }
            if (outcome.lost) {
                // Back on the surface at once, within rounding: decide again which way the solution goes.
                if (*outcome.lost >= m || impacts[*outcome.lost] || begun_again_) return FlowStatus::grazing;
                on_[*outcome.lost] = true;
                begun_again_ = true;
                continue;
            }
            if (outcome.at) return pass(*outcome.at, outcome.event, until);
            walk_.accept();
            begun_again_ = false;
            if (length >= 0.9 * limited_) {
                limited_ = std::min(2.0 * limited_, longest_);
                walk_.limit_length(limited_);
            }
            pull_back();
            const auto behind = watch_.positive(values_, values_of<N, n>(walk_.state()), s());
            for (std::size_t e = 0; e < begun_.size(); ++e)
                begun_[e] = begun_[e] && !behind[e];
            return FlowStatus::ok;
        }
    }

    [[nodiscard]] const Point& state() const { return walk_.state(); }
    [[nodiscard]] double s() const { return walk_.s(); }
    /// dx/ds with which the solution continues from here.
    [[nodiscard]] Point slope() {
        if (on_surface() && leave_surfaces() == FlowStatus::ok) pull_back();
        return walk_.slope();
    }
    [[nodiscard]] std::size_t steps() const { return walk_.steps(); }
    /// Surfaces met, including impacts.
    [[nodiscard]] std::size_t crossings() const { return crossings_; }
    /// Stretches of sliding entered.
    [[nodiscard]] std::size_t stickings() const { return stickings_; }

private:
    static constexpr std::array<bool, m> impacts = impacts_of<M>();
    using Watch = SurfaceWatch<M>;
    using Event = SurfaceEvent<M, N, order>;

    [[nodiscard]] bool on_surface() const { return on_ != std::array<bool, m>{}; }
    void turn_to(const Side<M>& side, std::size_t held) {
        auto& field = walk_.altered_field();
        field.side = values_.side = side;
        field.held = values_.held = held;
    }
    void set_piece() requires InputModel<M> {
        if (values_.piece == knots_->piece()) return;
        walk_.set_piece(knots_->piece());
        values_.piece = knots_->piece();
    }

    /// From a point on the surfaces of on_: which way the solution leaves, or what holds it.
    [[nodiscard]] FlowStatus leave_surfaces() {
        const State<double, n> x = values_of<N, n>(walk_.state());
        const auto next = continuation<m>(on_, impacts, values_.side, [&](const Side<M>& side) {
            const auto h = values_.moving(x, values_.one_sided(x, s(), side), s());
            std::array<double, m> rates;
            for (std::size_t j = 0; j < m; ++j)
                rates[j] = h[j].partial[0];
            return rates;
        });
        if (!next) {
            const auto f = values_.one_sided(x, s(), values_.side);
            if (!std::all_of(f.begin(), f.end(), [](double c) { return std::isfinite(c); }))
                return FlowStatus::not_finite;
            for (std::size_t j = 0; j < m; ++j)
                if (on_[j] && impacts[j]) return FlowStatus::grazing;
            return FlowStatus::held_twice;
        }
        if (next->held < m && next->held != values_.held) ++stickings_;
        turn_to(next->side, next->held);
        for (std::size_t j = 0; j < m; ++j)
            if (on_[j]) begun_[j] = true;
        begun_[Watch::released_up] = begun_[Watch::released_down] = false;
        on_.fill(false);
        return FlowStatus::ok;
    }

    /// Onto the surface that holds the solution, if one does.
    void pull_back() {
        if (values_.held < m) walk_.restart(walk_.field().pulled_back(walk_.state(), s()), s());
    }

    /// Steps to an event and through it: to the other side, into sliding or out of it, or by a jump of the state.
    [[nodiscard]] FlowStatus pass(double ds, std::size_t j, double until) {
        const double at = std::min(s() + ds, until);
        const double probe = 1e-4 * walk_.attempted();
        Point x = ds > 0.0 ? walk_.after(ds) : walk_.state();
        begun_again_ = false;
        if (j >= m) return release(x, at, j == Watch::released_up, probe);
        const State<double, n> arrival = values_of<N, n>(x);
        const double rate = values_.moving(arrival, values_(arrival, at), at)[j].partial[0];
        walk_.restart(x, at);
        if (Event::touches(values_, arrival, j, at, rate, probe)) return FlowStatus::grazing;
        ++crossings_;
        const auto arriving = walk_.field();
        T later(0.0);
        if constexpr (N > 0) {
            later = Event::crossing_time(arriving, x, at, j, rate);
            x = Event::shifted(arriving, x, T(at), later);
        }
        on_.fill(false);
        on_[j] = true;
        if constexpr (ImpactModel<M>) {
            if (impacts[j]) {
                x = arriving.model.reset(j, arriving.time(at + later), x, arriving.constants);
                // Impacts too close to be distinguished in time: they accumulate here.
                const double resolution = 64.0 * std::numeric_limits<double>::epsilon() * std::abs(at);
                walk_.restart(x, at);
                if (at - last_impact_[j] <= resolution) return FlowStatus::grazing;
                last_impact_[j] = at;
                look_around(values_of<N, n>(x), at);
            }
        }
        if (values_.held < m && !impacts[j]) on_[values_.held] = true;
        walk_.restart(x, at);
        if (const FlowStatus status = leave_surfaces(); status != FlowStatus::ok) return status;
        if constexpr (N > 0) walk_.restart(Event::shifted(walk_.field(), x, at + later, -later), at);
        pull_back();
        return FlowStatus::ok;
    }

    /// Out of sliding, to the side +1 (`up`) or -1. The fields agree there, so the time of the release moves nothing:
    /// X+ = X- in (M5). Their derivatives differ, so to second order it does.
    [[nodiscard]] FlowStatus release(Point x, double at, bool up, double probe) {
        const std::size_t j = values_.held;
        Side<M> side = values_.side;
        side[j] = up ? 1.0 : -1.0;
        begun_[j] = true;
        if constexpr (order == 2) {
            const auto later = Event::release_time(walk_.field(), values_, x, at, up, probe);
            if (!later) return FlowStatus::grazing;
            x = Event::shifted(walk_.field(), x, T(at), *later);
            turn_to(side, m);
            x = Event::shifted(walk_.field(), x, at + *later, -*later);
        }
        turn_to(side, m);
        walk_.restart(x, at);
        return FlowStatus::ok;
    }

    /// After a jump of the state: its new sides, and whether it is still on the surfaces that it was on.
    void look_around(const State<double, n>& x, double at) {
        using Gradient = Dual<n>;
        State<Gradient, n> y;
        for (std::size_t i = 0; i < n; ++i)
            y[i] = Gradient::variable(x[i], i);
        const auto h = values_.model.surfaces(Gradient(values_.time(at)), y, constants_as<Gradient>(values_.constants));
        Side<M> side = values_.side;
        for (std::size_t k = 0; k < m; ++k) {
            // On the surface means: within the error of a step.
            double allowed = 0.0;
            for (std::size_t i = 0; i < n; ++i)
                allowed += std::abs(h[k].partial[i]) *
                           (options_.absolute_tolerance + options_.relative_tolerance * std::abs(x[i]));
            const bool on = std::abs(h[k].value) <= allowed;
            if (on_[k] || k == values_.held)
                on_[k] = on;
            else if (h[k].value == 0.0 && !impacts[k])
                on_[k] = true;
            if (!on_[k] && !impacts[k] && (h[k].value > 0.0) != (side[k] > 0.0)) {
                side[k] = -side[k];
                begun_[k] = false;
            }
        }
        turn_to(side, m);
    }

    ControlledStep<M, N, order, SurfaceField<M, N, order>> walk_;
    SurfaceField<M, 0> values_;  ///< the same field without derivatives: events are located on it
    Watch watch_;
    FlowOptions options_;
    std::optional<InputKnots> knots_;
    std::array<bool, m> on_{};             ///< surfaces on which the state lies, before its continuation is decided
    typename Watch::Marks begun_{};        ///< surfaces that the state is just leaving
    std::array<double, m> last_impact_{};  ///< s of the last impact on each surface
    double longest_ = std::numeric_limits<double>::infinity(), limited_ = longest_;
    bool begun_again_ = false;
    std::size_t crossings_ = 0, stickings_ = 0;
};

}  // namespace orbid::models
