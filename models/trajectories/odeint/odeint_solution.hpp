#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include <boost/numeric/odeint/stepper/controlled_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/dense_output_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>

#include "models/system/stopped.hpp"
#include "models/trajectories/odeint/variational_equations.hpp"

namespace orbid::models {

namespace detail {

namespace odeint = boost::numeric::odeint;

/// What ends a solution inside a step of Odeint.
struct StepFailure {
    FlowStatus status;
};

/// What the measure of errors needs to know and count; Odeint copies the measure itself.
struct ErrorRecord {
    std::vector<bool> angles;
    FlowOptions options;
    std::size_t judged;     ///< numbers of the solution whose errors count, the coordinates first
    std::size_t steps = 0;  ///< every attempt
    double from = 0.0;      ///< where the step starts
};

/// Largest ratio of estimated to allowed local error.
class ErrorMeasure {
public:
    explicit ErrorMeasure(ErrorRecord* record = nullptr) : record_(record) {}

    template <class Algebra, class Numbers>
    [[nodiscard]] double error(Algebra& /*algebra*/, const Numbers& x, const Numbers& slope, const Numbers& error,
                               double ds) const {
        if (++record_->steps > record_->options.maximum_steps) throw StepFailure{FlowStatus::step_budget};
        const std::size_t n = record_->angles.size();
        // A shorter step helps unless f itself is undefined here, or none is left.
        if (!std::all_of(slope.begin(), slope.begin() + static_cast<std::ptrdiff_t>(n),
                         [](double f) { return std::isfinite(f); }) ||
            !(record_->from + ds > record_->from))
            throw StepFailure{FlowStatus::not_finite};
        double worst = 0.0;
        const auto judge = [&worst](double size, double allowed) {
            const double ratio = std::abs(size) / allowed;
            // nan must come out as a failed step: max(worst, nan) would drop it.
            if (!(ratio <= worst)) worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : ratio;
        };
        // The end of the step is not told: the size there is taken along the tangent.
        const auto size_of = [&](std::size_t k) { return std::max(std::abs(x[k]), std::abs(x[k] + ds * slope[k])); };
        const double relative = record_->options.relative_tolerance;
        for (std::size_t i = 0; i < n; ++i) {
            const double size = record_->angles[i] ? std::min(size_of(i), std::numbers::pi) : size_of(i);
            judge(error[i], record_->options.absolute_tolerance + relative * size);
        }
        for (std::size_t column = n; column < record_->judged; column += n) {
            double size = 1.0;
            for (std::size_t i = 0; i < n; ++i)
                size = std::max(size, size_of(column + i));
            for (std::size_t i = 0; i < n; ++i)
                judge(error[column + i], 10.0 * relative * size);
        }
        return worst;
    }

private:
    ErrorRecord* record_;
};

}  // namespace detail

/// One solution of smooth equations on its way, with derivatives, by Boost.Odeint: error-controlled steps of the pair
/// of Dormand and Prince of the orders 5 and 4, and between their ends its interpolant of order 4. Instants that are
/// asked for do not change the steps.
///
/// The measure of an error is that of the library's own stepper (error_ratio in stepper.hpp): values to absolute +
/// relative |x|, an angle counting with at most pi, and derivatives by the start to ten times relative, when there are
/// any. Those by parameters ride along, unless second derivatives are carried: these may have kinks where the first
/// have none (quadratic friction at rest), so all count.
///
/// Why this pair: its estimate is the difference of two quadratures of different order, also where f depends on time
/// alone (that of Fehlberg's 7(8) pair is 0 there); and Odeint lets its controller take a measure of one's own, which
/// its dense Bulirsch-Stoer stepper does not.
class OdeintSolution {
public:
    using Numbers = std::vector<double>;

    /// @param order  0: values alone, 1: first derivatives, 2: second ones as well
    OdeintSolution(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free, int order)
        : equations_(kernel, start, free, order),
          record_{{}, start.options, equations_.size()},
          dense_(Controlled(detail::ErrorMeasure(&record_), Adjuster(longest_length()))) {
        for (const Coordinate& coordinate : kernel.coordinates())
            record_.angles.push_back(coordinate.angle);
        const std::size_t n = record_.angles.size();
        if (order == 1) record_.judged = n + n * n;
        const Numbers y = equations_.from(start.state);
        dense_.initialize(y, 0.0, first_length(y));
    }
    OdeintSolution(const OdeintSolution&) = delete;
    OdeintSolution& operator=(const OdeintSolution&) = delete;

    /// A new start at s = 0; the step size is kept.
    void restart(const double* state) { dense_.initialize(equations_.from(state), 0.0, dense_.current_time_step()); }
    /// Replaces options.maximum_steps: all steps taken so far count.
    void limit_steps(std::size_t maximum) { record_.options.maximum_steps = maximum; }

    /// One accepted step.
    [[nodiscard]] FlowStatus step() {
        stop_if_asked(record_.options.interrupted);
        record_.from = end();
        try {
            (void)dense_.do_step(std::ref(equations_));
        } catch (const detail::StepFailure& failure) {
            return failure.status;
        } catch (const detail::odeint::step_adjustment_error&) {
            return FlowStatus::not_finite;
        }
        return FlowStatus::ok;
    }
    /// Steps until the last one reaches s.
    [[nodiscard]] FlowStatus advance(double s) {
        FlowStatus status = FlowStatus::ok;
        while (end() < s && status == FlowStatus::ok)
            status = step();
        return status;
    }

    /// End of the last step: s is the phase since the start for a forced model, else the time [s].
    [[nodiscard]] double end() const { return dense_.current_time(); }
    /// The solution there, and at s within the last step; layout of VariationalEquations.
    [[nodiscard]] const Numbers& end_state() const { return dense_.current_state(); }
    [[nodiscard]] Numbers at(double s) const {
        if (s == end()) return end_state();
        Numbers y(end_state().size());
        dense_.calc_state(s, y);
        return y;
    }
    /// Its derivatives at s become those at a fixed time.
    void at_fixed_time(Numbers& y, double s) { equations_.at_fixed_time(y, s); }
    /// Attempts so far, accepted and rejected.
    [[nodiscard]] std::size_t steps() const { return record_.steps; }

private:
    using Pair = detail::odeint::runge_kutta_dopri5<Numbers>;
    using Controlled = detail::odeint::controlled_runge_kutta<Pair, detail::ErrorMeasure>;
    using Adjuster = detail::odeint::default_step_adjuster<double, double>;

    /// A quarter of the forcing's period is the longest step: at rest all errors may be 0 for a while. 0: no limit.
    [[nodiscard]] double longest_length() const { return equations_.forced() ? std::numbers::pi / 2.0 : 0.0; }

    /// A step length to begin with, as ControlledStep takes it; the first error estimates correct it.
    [[nodiscard]] double first_length(const Numbers& y) {
        if (equations_.forced()) return 2.0 * std::numbers::pi / 40.0;
        Numbers slope(y.size());
        equations_(y, slope, 0.0);
        double rate = 0.0;
        for (std::size_t i = 0; i < record_.angles.size(); ++i)
            rate = std::max(rate, std::abs(slope[i]) / (std::abs(y[i]) + 1e-3));
        return std::isfinite(rate) && rate > 0.0 ? 0.01 / rate : 0.01;
    }

    VariationalEquations equations_;
    detail::ErrorRecord record_;
    detail::odeint::dense_output_runge_kutta<Controlled> dense_;
};

}  // namespace orbid::models
