#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "models/system/stopped.hpp"
#include "models/trajectories/stepper.hpp"

namespace orbid::models {

/// The solution of one field: the state at s, the slope there, and error-controlled steps. Events inside a step
/// (switching, sections) are left to the user of the class: a step is first found, then accepted.
///
///     FlowStatus status = walk.attempt(target);     // tries until the tolerance is kept; nothing has moved
///     ... walk.end(), walk.attempted() ...          // look for events between walk.state() and walk.end()
///     walk.accept();                                // or walk.restart(x, s) with the event inside it
///
/// All decisions use the same directions as error_ratio(), so that they are the same for every N >= n.
///
/// F is the field, or one derived from it.
template <Model M, std::size_t N, std::size_t order = 1, class F = Field<M, N, order>>
class ControlledStep {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    ControlledStep(const F& field, const FlowOptions& options) : field_(field), options_(options) {}

    /// A new place; the length of the next step is kept.
    void restart(const Point& x, double s) {
        x_ = x;
        low_ = Point{};
        s_ = s;
        forget_slopes();
    }
    void set_side(const Side<M>& side) {
        field_.side = side;
        forget_slopes();
    }
    void set_piece(std::size_t piece) {
        field_.piece = piece;
        forget_slopes();
    }
    void limit_steps(std::size_t maximum) { options_.maximum_steps = maximum; }
    void set_length(double ds) { step_ = ds; }
    /// No step is longer than this, whatever the errors allow.
    void limit_length(double ds) { longest_ = ds; }
    /// Gives the field to be altered.
    [[nodiscard]] F& altered_field() {
        forget_slopes();
        return field_;
    }

    /// A first step length: a fortieth of the forcing's period, or a hundredth of the time in which the state would
    /// change by its own size. The first error estimate corrects it.
    [[nodiscard]] double first_length() {
        if constexpr (ForcedModel<M>) {
            const double period = 2.0 * std::numbers::pi;
            return (field_.clock == Clock::phase ? period : period / value_of(field_.omega)) / 40.0;
        } else {
            double rate = 0.0;
            for (std::size_t i = 0; i < n; ++i)
                rate = std::max(rate, std::abs(value_of(slope()[i])) / (std::abs(value_of(x_[i])) + 1e-3));
            return std::isfinite(rate) && rate > 0.0 ? 0.01 / rate : 0.01;
        }
    }

    /// Looks for a step from s towards target (> s) whose error is allowed; counts every try.
    [[nodiscard]] FlowStatus attempt(double target) {
        for (;;) {
            if (steps_ >= options_.maximum_steps) return FlowStatus::step_budget;
            stop_if_asked(options_.interrupted);
            ++steps_;
            const double remaining = target - s_;
            // Two equal steps instead of a full one and a tiny rest; a rest of 1e-6 is included in the step.
            const double wanted = std::min(step_, longest_);
            ds_ = wanted >= remaining * (1.0 - 1e-6) ? remaining : std::min(wanted, 0.5 * remaining);
            if (!(s_ + ds_ > s_)) return FlowStatus::not_finite;
            Point error;
            low_end_ = low_;
            end_slope_known_ = false;
            stepper_.step(field_, x_, low_end_, slope(), s_, ds_, end_, error);
            if (!finite(end_)) {
                // A shorter step helps unless f itself is undefined here.
                if (!finite(slope())) return FlowStatus::not_finite;
                step_ = 0.25 * ds_;
                continue;
            }
            const double ratio = error_ratio<M, N, order>(error, x_, end_, options_, field_.model);
            // The estimate goes with the ninth power of the step. Safety 0.9, change at most 5 times.
            constexpr double exponent = -1.0 / flow_method.error_order;
            factor_ = ratio > 0.0 ? std::clamp(0.9 * std::pow(ratio, exponent), 0.2, 5.0) : 5.0;
            if (ratio <= 1.0) {
                // The exact target, whatever rounding would make of s + (target - s).
                s_end_ = ds_ == remaining ? target : s_ + ds_;
                return FlowStatus::ok;
            }
            step_ = ds_ * std::min(factor_, 0.9);
        }
    }

    /// Moves to the end of the step attempted.
    void accept() {
        x_ = end_;
        low_ = low_end_;
        s_ = s_end_;
        slope_known_ = end_slope_known_;
        if (slope_known_) slope_ = end_slope_;
        end_slope_known_ = false;
        // A step shortened to end at the target must not shorten the next one.
        step_ = ds_ < step_ ? std::max(step_, ds_ * factor_) : ds_ * factor_;
    }

    /// State a step of ds after the present one, on the present side; ds inside the step attempted.
    [[nodiscard]] Point after(double ds) {
        Point low = low_, end, error;
        stepper_.step(field_, x_, low, slope(), s_, ds, end, error);
        return end;
    }

    [[nodiscard]] const F& field() const { return field_; }
    [[nodiscard]] const Point& state() const { return x_; }
    [[nodiscard]] double s() const { return s_; }
    /// dx/ds at the present state.
    [[nodiscard]] const Point& slope() {
        if (!slope_known_) {
            slope_ = field_(x_, s_);
            slope_known_ = true;
        }
        return slope_;
    }
    /// dx/ds at the end of the step attempted, on the present side; what follows after accept() begins with it.
    [[nodiscard]] const Point& end_slope() {
        if (!end_slope_known_) {
            end_slope_ = field_(end_, s_end_);
            end_slope_known_ = true;
        }
        return end_slope_;
    }
    /// Length and end of the step attempted.
    [[nodiscard]] double attempted() const { return ds_; }
    [[nodiscard]] const Point& end() const { return end_; }
    /// Attempts so far, accepted and rejected.
    [[nodiscard]] std::size_t steps() const { return steps_; }

private:
    static bool finite(const Point& x) {
        return std::all_of(x.begin(), x.end(), [](const T& c) { return std::isfinite(value_of(c)); });
    }
    void forget_slopes() {
        slope_known_ = false;
        end_slope_known_ = false;
    }

    F field_;
    FlowOptions options_;
    Stepper<M, N, order> stepper_;
    Point x_;
    Point slope_{};
    Point end_{};
    Point end_slope_{};
    Point low_{};      ///< what the rounding of the state has lost, see Stepper
    Point low_end_{};  ///< the same at the end of the step attempted
    double s_ = 0.0;
    double step_ = 0.0;
    double longest_ = std::numeric_limits<double>::infinity();
    double ds_ = 0.0;
    double s_end_ = 0.0;
    double factor_ = 1.0;
    bool slope_known_ = false;
    bool end_slope_known_ = false;
    std::size_t steps_ = 0;
};

}  // namespace orbid::models
