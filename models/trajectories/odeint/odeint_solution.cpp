#include "models/trajectories/odeint/odeint_solution.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include <boost/numeric/odeint/stepper/controlled_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/dense_output_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>

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
    bool derivatives = false;
    bool second_derivatives = false;
    std::size_t steps = 0;
    double from = 0.0;  ///< where the step starts
};

/// Largest ratio of estimated to allowed local error; counts every attempt.
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
        for (std::size_t j = 0; record_->derivatives && j < n; ++j) {
            const std::size_t column = n + j * n;
            double size = 1.0;
            for (std::size_t i = 0; i < n; ++i)
                size = std::max(size, size_of(column + i));
            for (std::size_t i = 0; i < n; ++i)
                judge(error[column + i], 10.0 * relative * size);
        }
        // Second derivatives may have kinks where the first have none (quadratic friction at rest): each column counts.
        for (std::size_t column = n + n * n; record_->second_derivatives && column < x.size(); column += n) {
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

using Numbers = std::vector<double>;
using Pair = odeint::runge_kutta_dopri5<Numbers>;
using Controlled = odeint::controlled_runge_kutta<Pair, ErrorMeasure>;
using Dense = odeint::dense_output_runge_kutta<Controlled>;

/// A step length to begin with, as ControlledStep takes it; the first error estimates correct it.
inline double first_length(VariationalEquations& equations, const Numbers& y) {
    if (equations.forced()) return 2.0 * std::numbers::pi / 40.0;
    Numbers slope(y.size());
    equations(y, slope, 0.0);
    double rate = 0.0;
    for (std::size_t i = 0; i < equations.dimension(); ++i)
        rate = std::max(rate, std::abs(slope[i]) / (std::abs(y[i]) + 1e-3));
    return std::isfinite(rate) && rate > 0.0 ? 0.01 / rate : 0.01;
}

/// A quarter of the forcing's period is the longest step: at rest all errors may be 0 for a while. 0: no limit.
inline double longest_length(const VariationalEquations& equations) {
    return equations.forced() ? std::numbers::pi / 2.0 : 0.0;
}

}  // namespace detail

struct OdeintSolution::Stepping {
    VariationalEquations equations;
    detail::ErrorRecord record;
    detail::Dense dense;

    Stepping(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free, int order)
        : equations(kernel, start, free, order),
          dense(detail::Controlled(detail::ErrorMeasure(&record), detail::odeint::default_step_adjuster<double, double>(
                                                                      detail::longest_length(equations)))) {
        for (const Coordinate& coordinate : kernel.coordinates())
            record.angles.push_back(coordinate.angle);
        record.options = start.options;
        record.derivatives = order > 0;
        record.second_derivatives = order > 1;
        const std::vector<double> y = equations.from(start.state);
        dense.initialize(y, 0.0, detail::first_length(equations, y));
    }
    Stepping(const Stepping&) = delete;
    Stepping& operator=(const Stepping&) = delete;
};

OdeintSolution::OdeintSolution(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free,
                               int order)
    : stepping_(std::make_unique<Stepping>(kernel, start, free, order)) {}

OdeintSolution::~OdeintSolution() = default;

void OdeintSolution::restart(const double* state) {
    stepping_->dense.initialize(stepping_->equations.from(state), 0.0, stepping_->dense.current_time_step());
}

void OdeintSolution::limit_steps(std::size_t maximum) {
    stepping_->record.options.maximum_steps = maximum;
}

FlowStatus OdeintSolution::step() {
    stepping_->record.from = end();
    try {
        (void)stepping_->dense.do_step(std::ref(stepping_->equations));
    } catch (const detail::StepFailure& failure) {
        return failure.status;
    } catch (const detail::odeint::step_adjustment_error&) {
        return FlowStatus::not_finite;
    }
    return FlowStatus::ok;
}

FlowStatus OdeintSolution::advance(double s) {
    FlowStatus status = FlowStatus::ok;
    while (end() < s && status == FlowStatus::ok)
        status = step();
    return status;
}

double OdeintSolution::begin() const {
    return stepping_->dense.previous_time();
}
double OdeintSolution::end() const {
    return stepping_->dense.current_time();
}

const std::vector<double>& OdeintSolution::end_state() const {
    return stepping_->dense.current_state();
}

std::vector<double> OdeintSolution::at(double s) const {
    if (s == end()) return end_state();
    std::vector<double> y(end_state().size());
    stepping_->dense.calc_state(s, y);
    return y;
}

void OdeintSolution::at_fixed_time(std::vector<double>& y, double s) {
    stepping_->equations.at_fixed_time(y, s);
}

std::size_t OdeintSolution::steps() const {
    return stepping_->record.steps;
}

}  // namespace orbid::models
