#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "models/trajectories/controlled_step.hpp"
#include "models/trajectories/input_knots.hpp"
#include "models/trajectories/sticking.hpp"
#include "models/trajectories/velocity_watch.hpp"

namespace orbid::models {

/// One solution of a model, with N directions of derivative (M4). Its error-controlled steps end at the requested
/// instants; switching is located and passed by (M5), and sticking is handled.
///
/// Every decision (step size, events, sticking) uses the values and, when N >= n, the derivatives with respect to the
/// start. These are the first n directions of every trajectory with derivatives. All such trajectories take the same
/// steps and have bit-identical values. N = 0 controls the values only.
template <Model M, std::size_t N, std::size_t order = 1>
class Trajectory {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    /// @param p      parameters, with partials in the directions that are asked for
    /// @param input  of an InputModel
    Trajectory(const Values<T, parameter_count_of<M>>& p, const Point& x0, double phase, Clock clock,
               const FlowOptions& options, [[maybe_unused]] const InputSignal* input = nullptr, const M& model = M())
        : walk_(Field<M, N, order>(p, phase, clock, model), options),
          values_(values_of<N, parameter_count_of<M>>(p), phase, clock, model) {
        if constexpr (InputModel<M>) {
            knots_.emplace(*input, phase);
            walk_.altered_field().input = values_.input = input;
        }
        restart(x0);
        walk_.set_length(walk_.first_length());
    }

    /// A new start at s. The step size is kept, as the next piece of the same solution will need a similar one.
    void restart(const Point& x0, double s = 0.0) {
        walk_.restart(x0, s);
        if constexpr (InputModel<M>) {
            knots_->enter(s);
            set_piece();
        }
        stuck_ = false;
        on_surface_ = false;
        if constexpr (SwitchingModel<M>) {
            const double v = value_of(x0[velocity]);
            on_surface_ = v == 0.0;
            face(v < 0.0 ? -1.0 : 1.0);
        }
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

    /// Moves on by one accepted step, at most to s = target (behind the present s). It is shorter at the instants of a
    /// measured input and when the switching surface is met, where it ends just behind it (or held by it). Sticking
    /// lasts until it ends or the target is reached. Between the ends of a step that met nothing the solution is
    /// smooth.
    [[nodiscard]] FlowStatus step_towards(double target) {
        for (;;) {
            double until = target;
            if constexpr (InputModel<M>) {
                if (!knots_->proceed(s(), target)) return FlowStatus::no_input;
                until = knots_->until();
                set_piece();
            }
            if constexpr (SwitchingModel<M>) {
                if (on_surface_) leave_start();
                if (stuck_) return release(until);
            }
            const FlowStatus status = walk_.attempt(until);
            if (status != FlowStatus::ok) return status;
            if constexpr (SwitchingModel<M>) {
                const auto meeting =
                    VelocityWatch<M>(values_, values_of<N, n>(walk_.state()), values_of<N, n>(walk_.slope()), s())
                        .meeting_within(walk_.attempted(), values_of<N, n>(walk_.end()),
                                        [this]() -> const Point& { return walk_.end_slope(); });
                if (meeting.wrong_side) {
                    face(-values_.side);
                    continue;
                }
                if (meeting.at) return pass(*meeting.at, until);
            }
            walk_.accept();
            return FlowStatus::ok;
        }
    }

    [[nodiscard]] const Point& state() const { return walk_.state(); }
    [[nodiscard]] double s() const { return walk_.s(); }
    /// dx/ds with which the solution continues from here: 0 while it sticks.
    [[nodiscard]] Point slope() {
        if constexpr (SwitchingModel<M>) {
            if (on_surface_) leave_start();
            if (stuck_) return Point{};
        }
        return walk_.slope();
    }
    [[nodiscard]] std::size_t steps() const { return walk_.steps(); }
    [[nodiscard]] std::size_t crossings() const { return crossings_; }
    [[nodiscard]] std::size_t stickings() const { return stickings_; }

private:
    void set_piece() requires InputModel<M> {
        if (values_.piece == knots_->piece()) return;
        walk_.set_piece(knots_->piece());
        values_.piece = knots_->piece();
    }

    void face(double side) {
        walk_.set_side(side);
        values_.side = side;
    }

    /// Held at velocity 0: its partials are 0 too.
    void stick(Point x, double s) {
        x[velocity] = T(0.0);
        walk_.restart(x, s);
        stuck_ = true;
        ++stickings_;
    }

    /// The start lies on the surface: the side to which it leaves, or sticking.
    void leave_start() requires SwitchingModel<M> {
        on_surface_ = false;
        const SurfaceAccelerations a = surface_accelerations(values_, values_of<N, n>(walk_.state()), s());
        if (a.hold()) return stick(walk_.state(), s());
        face(a.negative < 0.0 ? -1.0 : 1.0);
    }

    /// Sticking until it ends or the target is reached.
    [[nodiscard]] FlowStatus release(double target) requires SwitchingModel<M> {
        const auto end = release_after(values_, values_of<N, n>(walk_.state()), s(), target);
        // The slopes agree on both sides of a release (both are 0), so its time moves nothing: X+ = X- in (M5).
        walk_.restart(walk_.state(), end ? end->s : target);
        if (!end) return FlowStatus::ok;
        stuck_ = false;
        face(end->side);
        if constexpr (order == 2) return release_time();
        return FlowStatus::ok;
    }

    /// Second derivatives at a release: the velocity grows with the square of the time since then. One Newton step on
    /// the acceleration gives the event time with its derivatives to first order, which is all that enters. The
    /// state is then moved back by it.
    [[nodiscard]] FlowStatus release_time() requires SwitchingModel<M> {
        const Field<M, N, order>& field = walk_.field();
        const Point x = walk_.state();
        // The derivative by time: a time with partial 1 in the extra direction, minus what that direction already has.
        T now(s());
        const T pull = field(x, now)[velocity];
        now.partial[0].value = 1.0;
        const double rate = field(x, now)[velocity].partial[0].value - pull.partial[0].value;
        if (!(std::abs(rate) > 0.0)) return FlowStatus::grazing;
        const T later = nilpotent(-pull / rate);
        walk_.restart(Stepper<M, N, order>().moved(field, x, s() + later, -later), s());
        return FlowStatus::ok;
    }

    /// The same derivatives with value 0.
    static T nilpotent(T x) requires(order == 2) {
        x.value.value = 0.0;
        return x;
    }

    /// Steps to the surface and through it, or sticks.
    [[nodiscard]] FlowStatus pass(double ds, double target) requires SwitchingModel<M> {
        Point end = walk_.after(ds);
        const Point start = walk_.state();
        const double side = values_.side, from = s();
        const double at = std::min(from + ds, target);
        walk_.restart(end, at);
        const SurfaceAccelerations a = surface_accelerations(values_, values_of<N, n>(end), at);
        const double arriving = side > 0.0 ? a.positive : a.negative;
        const double leaving = side > 0.0 ? a.negative : a.positive;
        const double jump = a.negative - a.positive;
        // Arriving without acceleration, where dry friction makes it jump. Rounding would decide between touching and
        // being held, and the instant cannot be determined. 1e-8 of the jump: half of the digits.
        if (jump > 0.0 && !(side * arriving < -1e-8 * jump)) return FlowStatus::grazing;
        ++crossings_;
        if constexpr (order == 2) {
            // (M5) to second order: two Newton steps on v = 0 make the event time a dual number.
            const Stepper<M, N, order> stepper;
            T later(0.0);
            for (int newton = 0; newton < 2; ++newton) {
                end = stepper.moved(walk_.field(), start, from, ds + later);
                later = later - nilpotent(end[velocity] / walk_.field()(end, from + ds + later)[velocity]);
            }
            end = stepper.moved(walk_.field(), start, from, ds + later);
            end[velocity] = T(0.0);
            if (!a.hold()) {
                // On from there by the other equations, back to the present instant.
                face(-side);
                walk_.restart(stepper.moved(walk_.field(), end, at + later, -later), at);
                return FlowStatus::ok;
            }
        }
        if (a.hold()) {
            stick(end, at);
            return FlowStatus::ok;
        }
        if constexpr (order == 1 && N > 0) {
            // (M5): one Newton step, dt* = -v / a-, makes the event time a dual number; the slopes of the position
            // agree.
            const double factor = jump > 0.0 ? leaving / arriving : 1.0;
            for (double& partial : end[velocity].partial)
                partial *= factor;
            end[velocity].value = 0.0;
        } else if constexpr (N == 0) {
            end[velocity] = 0.0;
        }
        walk_.restart(end, at);
        face(-side);
        return FlowStatus::ok;
    }

    ControlledStep<M, N, order> walk_;
    Field<M, 0> values_;               ///< the same field without derivatives: events are located on it
    std::optional<InputKnots> knots_;  ///< of an InputModel
    bool stuck_ = false;
    bool on_surface_ = false;
    std::size_t crossings_ = 0;
    std::size_t stickings_ = 0;
};

}  // namespace orbid::models
