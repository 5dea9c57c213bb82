#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "models/definition/model.hpp"
#include "models/definition/simulation.hpp"
#include "models/system/stopped.hpp"
#include "models/trajectories/explicit_method.hpp"

namespace orbid::models {

/// One solution of a DynamicModel, with N >= 1 directions of derivative (of order 2 also their derivatives in one
/// more). Its error-controlled steps use the method of all flows. A step is first found, then accepted, as in
/// ControlledStep.
///
/// Derivatives with respect to all n coordinates of the start are too many to be always carried, so step control does
/// not use them. Nor can it use the values alone, which allow any step at an equilibrium (see error_ratio in
/// stepper.hpp). Direction 0 is therefore a probe: one tangent vector with a component in every direction, whose
/// relative error counts beside that of the values. Every trajectory carries it. All therefore take the same steps and
/// have bit-identical values, whatever the other directions are.
///
/// Memory is allocated when a trajectory is made, and not again.
template <DynamicModel M, std::size_t N, std::size_t order = 1>
class DynamicTrajectory {
public:
    using T = Scalar<N, order>;
    using Parameters = Values<T, parameter_count_of<M>>;

    /// @param x0  partial 0 is overwritten by that of the probe
    /// @param p   partial 0 is 0
    DynamicTrajectory(const Parameters& p, std::vector<T> x0, const FlowOptions& options, const M& model = M())
        : model_(model), p_(p), options_(options), x_(std::move(x0)), end_(x_.size()), sum_(x_.size()) {
        for (auto& slope : slopes_)
            slope.resize(x_.size());
        // A chirp, whose spectrum is flat: it contains every Fourier mode of a ring or a chain. The multiples of the
        // golden ratio stay farthest from whole numbers.
        for (std::size_t i = 0; i < x_.size(); ++i) {
            const double turns = static_cast<double>((i + 1) * (i + 1)) * (std::numbers::phi - 1.0);
            probe(x_[i]) = 2.0 * (turns - std::floor(turns)) - 1.0;
        }
        evaluate(x_, slopes_[0]);
        // A hundredth of the time in which the state would change by its own size; the first error corrects it.
        double rate = 0.0;
        for (std::size_t i = 0; i < x_.size(); ++i)
            rate = std::max(rate, std::abs(value_of(slopes_[0][i])) / (std::abs(value_of(x_[i])) + 1e-3));
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
            stop_if_asked(options_.interrupted);
            ++steps_;
            const double remaining = target - time_;
            // Two equal steps instead of a full one and a tiny rest; a rest of 1e-6 is included in the step.
            dt_ = step_ >= remaining * (1.0 - 1e-6) ? remaining : std::min(step_, 0.5 * remaining);
            if (!(time_ + dt_ > time_)) return FlowStatus::not_finite;
            step(dt_, end_);
            const double ratio = error_ratio();
            // Safety 0.9, change at most 5 times.
            factor_ = ratio > 0.0 ? std::clamp(0.9 * std::pow(ratio, -1.0 / method.error_order), 0.2, 5.0) : 5.0;
            if (ratio <= 1.0) {
                // The exact target, whatever rounding would make of time + (target - time).
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
        evaluate(x_, slopes_[0]);
        // A step shortened to end at the target must not shorten the next one.
        step_ = dt_ < step_ ? std::max(step_, dt_ * factor_) : dt_ * factor_;
    }

    /// The state dt after the present one, dt inside the step attempted, which remains attempted.
    void after(double dt, std::vector<T>& x) { step(dt, x); }

    /// f at a state.
    void evaluate(const std::vector<T>& x, std::vector<T>& f) const {
        model_.rhs(T(0.0), std::span<const T>(x), p_, std::span<T>(f));
    }

    [[nodiscard]] const std::vector<T>& state() const { return x_; }
    [[nodiscard]] const std::vector<T>& slope() const { return slopes_[0]; }
    [[nodiscard]] double time() const { return time_; }
    [[nodiscard]] const std::vector<T>& end() const { return end_; }
    [[nodiscard]] double attempted() const { return dt_; }
    /// Attempts so far, accepted and rejected.
    [[nodiscard]] std::size_t steps() const { return steps_; }

private:
    static constexpr const auto& method = verner98;

    static double& probe(T& x) { return first_order(x).partial[0]; }
    static double probe(const T& x) { return first_order(x).partial[0]; }

    /// One step from the present state; leaves the other slopes and, in sum_, the estimated error over dt.
    void step(double dt, std::vector<T>& end) {
        for (std::size_t i = 1; i < method.stages; ++i) {
            combine(method.matrix[i], i);
            for (std::size_t c = 0; c < x_.size(); ++c)
                end[c] = multiply_add(dt, sum_[c], x_[c]);
            evaluate(end, slopes_[i]);
        }
        combine(method.weights.data(), method.stages);
        for (std::size_t c = 0; c < x_.size(); ++c)
            end[c] = multiply_add(dt, sum_[c], x_[c]);
        combine(method.error.data(), method.stages);
    }

    /// sum_ = sum_j row_j slope_j, j < count.
    void combine(const double* row, std::size_t count) {
        for (std::size_t c = 0; c < x_.size(); ++c)
            sum_[c] = row[0] * slopes_[0][c];
        for (std::size_t j = 1; j < count; ++j) {
            if (row[j] == 0.0) continue;
            for (std::size_t c = 0; c < x_.size(); ++c)
                sum_[c] = multiply_add(row[j], slopes_[j][c], sum_[c]);
        }
    }

    /// Largest ratio of estimated to allowed local error. Value: absolute + relative |x|, where an angle counts with at
    /// most pi. Probe: ten times relative, as its largest entry is about 1. Infinite when a value is not finite.
    [[nodiscard]] double error_ratio() const {
        double worst = 0.0;
        const auto judge = [&worst, this](double slope, double allowed) {
            const double ratio = std::abs(dt_ * slope) / allowed;
            // nan must come out as a failed step: max(worst, nan) would drop it.
            if (!(ratio <= worst)) worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : ratio;
        };
        for (std::size_t i = 0; i < x_.size(); ++i) {
            const double end = value_of(end_[i]);
            if (!std::isfinite(end)) return std::numeric_limits<double>::infinity();
            double size = std::max(std::abs(value_of(x_[i])), std::abs(end));
            if (model_.coordinate.angle) size = std::min(size, std::numbers::pi);
            judge(value_of(sum_[i]), options_.absolute_tolerance + options_.relative_tolerance * size);
            judge(probe(sum_[i]), 10.0 * options_.relative_tolerance);
        }
        return worst;
    }

    /// Keeps the largest entry of the probe in [1/2, 1): on a chaotic solution it would otherwise overflow. A power of
    /// 2 leaves its digits unchanged.
    void rescale_probe() {
        double size = 0.0;
        for (const T& x : x_)
            size = std::max(size, std::abs(probe(x)));
        int exponent = 0;
        std::frexp(size, &exponent);
        const double scale = std::ldexp(1.0, -exponent);
        for (T& x : x_)
            probe(x) *= scale;
    }

    [[no_unique_address]] M model_;
    Parameters p_;
    FlowOptions options_;
    std::vector<T> x_;
    std::vector<T> end_;
    std::vector<T> sum_;
    std::array<std::vector<T>, method.stages> slopes_;  ///< the first is that of x_
    double time_ = 0.0;
    double step_ = 0.0;
    double dt_ = 0.0;
    double time_at_end_ = 0.0;
    double factor_ = 1.0;
    std::size_t steps_ = 0;
};

}  // namespace orbid::models
