#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include <boost/numeric/odeint/stepper/runge_kutta_fehlberg78.hpp>

#include "models/model.hpp"
#include "models/simulation.hpp"

namespace orbid::models {

/// One solution of a DynamicModel on its way, with N >= 1 directions of derivative: error-controlled steps of the
/// Runge-Kutta-Fehlberg 7(8) method of Boost.Odeint. A step is first found, then accepted, as in ControlledStep.
///
/// Derivatives with respect to all n coordinates of the start are too many to be carried along always, so the steps do
/// not look at them. Nor may they look at the values alone, which allow any step at an equilibrium (see error_ratio in
/// stepper.hpp). Direction 0 is therefore a probe: one tangent vector that has a part in every direction, whose
/// relative error counts beside that of the values. Every trajectory carries it, so all take the same steps and have
/// bit-identical values, whatever the other directions are.
///
/// Memory is allocated when a trajectory is made, and not again.
template <DynamicModel M, std::size_t N>
class DynamicTrajectory {
public:
    using T = Dual<N>;
    using Parameters = Values<T, parameter_count_of<M>>;

    /// @param x0  partial 0 is overwritten by that of the probe
    /// @param p   partial 0 is 0
    DynamicTrajectory(const Parameters& p, std::vector<T> x0, const FlowOptions& options)
        : p_(p), options_(options), x_(std::move(x0)), slope_(x_.size()), end_(x_.size()), error_(x_.size()) {
        // A chirp, whose spectrum is flat: no Fourier mode of a ring or a chain is missing in it. The golden ratio is
        // the number whose multiples stay away most from whole numbers.
        for (std::size_t i = 0; i < x_.size(); ++i) {
            const double turns = static_cast<double>((i + 1) * (i + 1)) * (std::numbers::phi - 1.0);
            x_[i].partial[0] = 2.0 * (turns - std::floor(turns)) - 1.0;
        }
        evaluate(x_, slope_);
        // A hundredth of the time in which the state would change by its own size; the first error corrects it.
        double rate = 0.0;
        for (std::size_t i = 0; i < x_.size(); ++i)
            rate = std::max(rate, std::abs(slope_[i].value) / (std::abs(x_[i].value) + 1e-3));
        step_ = std::isfinite(rate) && rate > 0.0 ? 0.01 / rate : 0.01;
    }

    /// Moves on to the time `target` (not before the present one).
    [[nodiscard]] FlowStatus advance(double target) {
        while (time_ < target) {
            const FlowStatus status = attempt(target);
            if (status != FlowStatus::ok) return status;
            accept();
        }
        return FlowStatus::ok;
    }

    /// Looks for a step towards target (> time()) whose error is allowed; counts every try.
    [[nodiscard]] FlowStatus attempt(double target) {
        for (;;) {
            if (steps_ >= options_.maximum_steps) return FlowStatus::step_budget;
            ++steps_;
            const double remaining = target - time_;
            // Two equal steps instead of a full one and a crumb; a crumb of 1e-6 is taken along.
            dt_ = step_ >= remaining * (1.0 - 1e-6) ? remaining : std::min(step_, 0.5 * remaining);
            if (!(time_ + dt_ > time_)) return FlowStatus::not_finite;
            step(dt_, end_);
            const double ratio = error_ratio();
            // Order 8: the local error goes with the eighth power of the step. Safety 0.9, change at most 5 times.
            factor_ = ratio > 0.0 ? std::clamp(0.9 * std::pow(ratio, -0.125), 0.2, 5.0) : 5.0;
            if (ratio <= 1.0) {
                // The very target, whatever rounding would make of time + (target - time).
                time_at_end_ = dt_ == remaining ? target : time_ + dt_;
                return FlowStatus::ok;
            }
            step_ = dt_ * std::min(factor_, 0.9);
        }
    }

    /// Moves to the end of the step attempted.
    void accept() {
        std::swap(x_, end_);
        time_ = time_at_end_;
        rescale_probe();
        evaluate(x_, slope_);
        // A step that was cut to land must not shorten the next one.
        step_ = dt_ < step_ ? std::max(step_, dt_ * factor_) : dt_ * factor_;
    }

    /// The state dt after the present one, dt inside the step attempted; its error is not looked at.
    void after(double dt, std::vector<T>& x) { step(dt, x); }

    /// f at a state.
    void evaluate(const std::vector<T>& x, std::vector<T>& f) const {
        M::rhs(T(0.0), std::span<const T>(x), p_, std::span<T>(f));
    }

    [[nodiscard]] const std::vector<T>& state() const { return x_; }
    [[nodiscard]] const std::vector<T>& slope() const { return slope_; }
    [[nodiscard]] double time() const { return time_; }
    [[nodiscard]] const std::vector<T>& end() const { return end_; }
    [[nodiscard]] double attempted() const { return dt_; }
    /// Attempts so far, accepted and rejected.
    [[nodiscard]] std::size_t steps() const { return steps_; }

private:
    /// Every operation of the method on a dual number gives each of its parts what plain numbers would get.
    void step(double dt, std::vector<T>& end) {
        const auto system = [this](const std::vector<T>& x, std::vector<T>& f, double /*t*/) { evaluate(x, f); };
        method_.do_step(system, x_, slope_, time_, end, dt, error_);
    }

    /// Largest ratio of estimated to allowed local error: of a value, absolute + relative |x|, where an angle counts
    /// with at most pi; of the probe, ten times relative, as its largest entry is about 1. Infinite when a value is not
    /// finite.
    [[nodiscard]] double error_ratio() const {
        double worst = 0.0;
        const auto judge = [&worst](double size, double allowed) {
            const double ratio = std::abs(size) / allowed;
            // nan must come out as a failed step: max(worst, nan) would drop it.
            if (!(ratio <= worst)) worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : ratio;
        };
        for (std::size_t i = 0; i < x_.size(); ++i) {
            if (!std::isfinite(end_[i].value)) return std::numeric_limits<double>::infinity();
            double size = std::max(std::abs(x_[i].value), std::abs(end_[i].value));
            if (M::coordinate.angle) size = std::min(size, std::numbers::pi);
            judge(error_[i].value, options_.absolute_tolerance + options_.relative_tolerance * size);
            judge(error_[i].partial[0], 10.0 * options_.relative_tolerance);
        }
        return worst;
    }

    /// Keeps the largest entry of the probe in [1/2, 1): on a chaotic solution it would overflow in the end. A power of
    /// 2 leaves its digits as they are.
    void rescale_probe() {
        double size = 0.0;
        for (const T& x : x_)
            size = std::max(size, std::abs(x.partial[0]));
        int exponent = 0;
        std::frexp(size, &exponent);
        const double scale = std::ldexp(1.0, -exponent);
        for (T& x : x_)
            x.partial[0] *= scale;
    }

    Parameters p_;
    FlowOptions options_;
    boost::numeric::odeint::runge_kutta_fehlberg78<std::vector<T>, double> method_;
    std::vector<T> x_;
    std::vector<T> slope_;
    std::vector<T> end_;
    std::vector<T> error_;
    double time_ = 0.0;
    double step_ = 0.0;
    double dt_ = 0.0;
    double time_at_end_ = 0.0;
    double factor_ = 1.0;
    std::size_t steps_ = 0;
};

}  // namespace orbid::models
