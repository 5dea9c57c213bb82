#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "models/system/stopped.hpp"
#include "models/trajectories/implicit_stepper.hpp"
#include "models/trajectories/input_knots.hpp"

namespace orbid::models {

/// One solution of a stiff model, with N directions of derivative: the counterpart of Trajectory, by steps of Radau
/// IIA.
///
/// The error of a step is judged by the difference d to a formula of order 3, in units of the state's size. Where the
/// motion is not stiff, the error of order 5 is about d^(3/2). RADAU5, whose control of steps this is, therefore allows
/// d = 0.1 tolerance^(2/3). A component that is drawn to a slow motion has order 3 itself. Its error is d; the filter
/// of stiff directions makes it far smaller than the plain difference D. Both hold for d min(1, D)^(1/2), which is
/// allowed 0.03 tolerance. (With RADAU5's rule errors of such components were up to 900 times what was allowed, at
/// 1e-12.) Steps whose equations cannot be solved are halved. If a step becomes too short to move s, the status is
/// not_finite.
///
/// As in Trajectory, decisions depend on the values and the derivatives with respect to the start only.
template <StiffModel M, std::size_t N, std::size_t order = 1>
class ImplicitTrajectory {
    static_assert(!SwitchingModel<M>,
                  "a stiff model must be smooth: implicit steps do not look for switching surfaces");

public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    /// @param p      parameters, with partials in the directions that are asked for
    /// @param input  of an InputModel
    ImplicitTrajectory(const Values<T, parameter_count_of<M>>& p, const Point& x0, double phase, Clock clock,
                       const FlowOptions& options, [[maybe_unused]] const InputSignal* input = nullptr,
                       const M& model = M())
        : stepper_(p, phase, clock, model), options_(options) {
        if constexpr (InputModel<M>) {
            knots_.emplace(*input, phase);
            stepper_.set_input(input);
        }
        restart(x0);
        double rate = 0.0;
        const Point f = slope();
        for (std::size_t i = 0; i < n; ++i)
            rate = std::max(rate, std::abs(value_of(f[i])) / (std::abs(value_of(x_[i])) + 1e-3));
        // A thousandth of the time in which the state would change by its own size; the first estimates correct it.
        step_ = std::isfinite(rate) && rate > 0.0 ? 1e-3 / rate : 1e-3;
    }

    /// A new start at s. The step size is kept, as the next piece of the same solution will need a similar one.
    void restart(const Point& x0, double s = 0.0) {
        x_ = x0;
        s_ = s;
        slope_known_ = false;
        last_ = 0.0;
        rejected_ = false;
        if constexpr (InputModel<M>) {
            knots_->enter(s);
            stepper_.set_piece(knots_->piece());
        }
    }

    /// Replaces options.maximum_steps: all steps taken so far count.
    void limit_steps(std::size_t maximum) { options_.maximum_steps = maximum; }

    /// Moves on to s = target (not before the present s).
    [[nodiscard]] FlowStatus advance(double target) {
        FlowStatus status = FlowStatus::ok;
        while (s_ < target && status == FlowStatus::ok)
            status = step_towards(target);
        return status;
    }

    /// Moves on by one accepted step, at most to s = target (behind the present s).
    [[nodiscard]] FlowStatus step_towards(double target) {
        double until = target;
        if constexpr (InputModel<M>) {
            const std::size_t before = knots_->piece();
            if (!knots_->proceed(s_, target)) return FlowStatus::no_input;
            until = knots_->until();
            if (knots_->piece() != before) {
                stepper_.set_piece(knots_->piece());
                slope_known_ = false;
            }
        }
        for (;;) {
            if (steps_ >= options_.maximum_steps) return FlowStatus::step_budget;
            stop_if_asked(options_.interrupted);
            ++steps_;
            const double remaining = until - s_;
            // Two equal steps instead of a full one and a tiny rest; a rest of 1e-6 is included in the step.
            const double ds = step_ >= remaining * (1.0 - 1e-6) ? remaining : std::min(step_, 0.5 * remaining);
            if (!(s_ + ds > s_)) return FlowStatus::not_finite;
            auto stages = expected_stages(ds);
            Point end;
            if (!stepper_.step(x_, s_, ds, allowed(), stages, end)) {
                // Far away, a polynomial is a bad guess: the next attempt begins with the start itself.
                step_ = 0.5 * ds;
                last_ = 0.0;
                rejected_ = true;
                continue;
            }
            double ratio = ratio_of(ds, end, false);
            if (!(ratio < 1.0) && (rejected_ || first_)) ratio = ratio_of(ds, end, true);
            // The estimate goes with the sixth power of the step, with the fifth in stiff directions. Safety 0.9,
            // change at most 8 times.
            double factor = std::clamp(0.9 * std::pow(ratio, -power), 0.125, 8.0);
            if (!(ratio < 1.0)) {
                step_ = first_ ? 0.1 * ds : ds * std::min(factor, 0.9);
                rejected_ = true;
                continue;
            }
            // Prediction of the next error from the last two (Gustafsson).
            if (accepted_ > 0.0)
                factor = std::min(
                    factor, std::max(0.125, 0.9 * ds / accepted_ * std::pow(accepted_ratio_ / (ratio * ratio), power)));
            if (rejected_) factor = std::min(factor, 1.0);
            accepted_ = ds;
            accepted_ratio_ = std::max(1e-2, ratio);
            rejected_ = first_ = false;
            // A step shortened to end at the target must not shorten the next one.
            step_ = ds < step_ ? std::max(step_, ds * factor) : ds * factor;
            x_ = end;
            s_ = ds == remaining ? until : s_ + ds;
            slope_known_ = false;
            last_ = ds;
            stages_ = stages;
            return FlowStatus::ok;
        }
    }

    [[nodiscard]] const Point& state() const { return x_; }
    [[nodiscard]] double s() const { return s_; }
    /// dx/ds with which the solution continues from here.
    [[nodiscard]] const Point& slope() {
        if (!slope_known_) {
            slope_ = stepper_.slope(x_, s_);
            slope_known_ = true;
        }
        return slope_;
    }
    [[nodiscard]] std::size_t steps() const { return steps_; }
    [[nodiscard]] std::size_t crossings() const { return 0; }
    [[nodiscard]] std::size_t stickings() const { return 0; }

private:
    using Stages = typename ImplicitStepper<M, N, order>::Stages;

    static constexpr double power = 1.0 / 6.0;

    /// Smallest size of a state that relative errors are judged by.
    [[nodiscard]] double unit() const { return options_.absolute_tolerance / options_.relative_tolerance; }

    /// Differences to the formula of order 3 that the options allow where a step is not stiff: the stages are iterated
    /// to a hundredth of that first.
    [[nodiscard]] State<double, n> allowed() const {
        const double relative = 0.1 * std::pow(options_.relative_tolerance, 2.0 / 3.0);
        State<double, n> scale;
        for (std::size_t i = 0; i < n; ++i)
            scale[i] = relative * (unit() + std::abs(value_of(x_[i])));
        return scale;
    }

    /// Largest ratio of estimated to allowed error, of the derivatives with respect to the start too.
    [[nodiscard]] double ratio_of(double ds, const Point& end, bool refine) {
        const auto d = stepper_.difference(x_, s_, ds, slope(), refine);
        Point error = d.filtered;
        const auto judge = [](double& filtered, double plain, double size) {
            // 30 = 0.1^(-3/2): the constant of RADAU5's rule.
            filtered *= 30.0 * std::sqrt(std::min(1.0, std::abs(plain) / size));
        };
        for (std::size_t i = 0; i < n; ++i)
            judge(value_in(error[i]), value_of(d.plain[i]), unit() + std::abs(value_of(end[i])));
        if constexpr (N >= n) {
            for (std::size_t j = 0; j < n; ++j) {
                double size = 1.0;
                for (std::size_t i = 0; i < n; ++i)
                    size = std::max(size, std::abs(first_order(end[i]).partial[j]));
                for (std::size_t i = 0; i < n; ++i)
                    judge(first_order(error[i]).partial[j], first_order(d.plain[i]).partial[j], size);
            }
        }
        return std::max(error_ratio<M, N, order>(error, x_, end, options_, stepper_.model()), 1e-15);
    }
    static double& value_in(double& x) { return x; }
    template <std::size_t K, class B>
    static double& value_in(Dual<K, B>& x) {
        return value_in(x.value);
    }

    /// The polynomial through the stages of the last step, continued over the next one.
    [[nodiscard]] Stages expected_stages(double ds) const {
        Stages z{};
        if (!(last_ > 0.0)) return z;
        const auto& c = RadauMethod::nodes;
        for (std::size_t i = 0; i < 3; ++i) {
            const double at = 1.0 + c[i] * ds / last_;
            // Lagrange's basis on 0, c_1, c_2, c_3; the value at 0 is 0.
            for (std::size_t j = 0; j < 3; ++j) {
                double weight = at / c[j];
                for (std::size_t k = 0; k < 3; ++k)
                    if (k != j) weight *= (at - c[k]) / (c[j] - c[k]);
                for (std::size_t k = 0; k < n; ++k)
                    z[i][k] += weight * stages_[j][k];
            }
            for (std::size_t k = 0; k < n; ++k)
                z[i][k] -= stages_[2][k];
        }
        return z;
    }

    ImplicitStepper<M, N, order> stepper_;
    FlowOptions options_;
    std::optional<InputKnots> knots_;
    Point x_;
    Point slope_;
    Stages stages_{};  ///< of the last step, whose length is last_ (0: none)
    double last_ = 0.0;
    double s_ = 0.0;
    double step_ = 0.0;
    double accepted_ = 0.0;
    double accepted_ratio_ = 0.0;
    bool slope_known_ = false;
    bool rejected_ = false;
    bool first_ = true;
    std::size_t steps_ = 0;
};

}  // namespace orbid::models
