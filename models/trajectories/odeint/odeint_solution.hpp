#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "models/system/kernel.hpp"

namespace orbid::models {

/// One solution of smooth equations on its way, with derivatives, by Boost.Odeint: error-controlled steps of the pair
/// of Dormand and Prince of the orders 5 and 4, and between their ends its interpolant of order 4. Instants that are
/// asked for do not change the steps.
///
/// The measure of an error is that of the library's own stepper (error_ratio in stepper.hpp): values to absolute +
/// relative |x|, an angle counting with at most pi, and derivatives by the start to ten times relative, when there are
/// any. Those by parameters ride along, unless second derivatives are carried: then all count.
///
/// Why this pair: its estimate is the difference of two quadratures of different order, also where f depends on time
/// alone (that of Fehlberg's 7(8) pair is 0 there); and Odeint lets its controller take a measure of one's own, which
/// its dense Bulirsch-Stoer stepper does not.
class OdeintSolution {
public:
    /// @param order  0: values alone, 1: first derivatives, 2: second ones as well
    OdeintSolution(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free, int order);
    ~OdeintSolution();
    OdeintSolution(const OdeintSolution&) = delete;
    OdeintSolution& operator=(const OdeintSolution&) = delete;

    /// A new start at s = 0; the step size is kept.
    void restart(const double* state);
    /// Replaces options.maximum_steps: all steps taken so far count.
    void limit_steps(std::size_t maximum);

    /// One accepted step.
    [[nodiscard]] FlowStatus step();
    /// Steps until the last one reaches s.
    [[nodiscard]] FlowStatus advance(double s);
    /// Begin and end of the last step: s is the phase since the start for a forced model, else the time [s].
    [[nodiscard]] double begin() const;
    [[nodiscard]] double end() const;
    /// The solution at the end of the last step, and at s within it; layout of VariationalEquations.
    [[nodiscard]] const std::vector<double>& end_state() const;
    [[nodiscard]] std::vector<double> at(double s) const;
    /// Its derivatives at s become those at a fixed time.
    void at_fixed_time(std::vector<double>& y, double s);
    /// Attempts so far, accepted and rejected.
    [[nodiscard]] std::size_t steps() const;

private:
    struct Stepping;
    std::unique_ptr<Stepping> stepping_;
};

}  // namespace orbid::models
