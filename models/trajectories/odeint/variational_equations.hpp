#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "models/system/kernel.hpp"

namespace orbid::models {

/// A solution and its derivatives as one ordinary differential equation over a vector of run-time size, for integrators
/// that know plain numbers only. With g = f / omega for a forced model, g = f for any other:
///
///     x'    = g
///     X'_i  = g_x X_i + g_i                                     i: the n coordinates of the start, then `free`
///     W'_ij = g_x W_ij + sum over a, b of g_ab Y_a,i Y_b,j      Y: X, and below it the identity for `free`
///
/// The variable s is the phase since the start (forced models) or the time [s]. Layout: x; then X column by column
/// (order 1 and 2); then W, column i d + j (order 2). Equations that the kernel compiled are called through its plain
/// functions: nothing here is instantiated per model.
class VariationalEquations {
public:
    /// @param order  0: values alone, 1: first derivatives, 2: second ones as well
    VariationalEquations(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free, int order);

    [[nodiscard]] std::size_t dimension() const { return n_; }
    /// n and the free parameters.
    [[nodiscard]] std::size_t directions() const { return d_; }
    [[nodiscard]] int order() const { return order_; }
    [[nodiscard]] bool forced() const { return omega_.has_value(); }
    /// Numbers of the layout above.
    [[nodiscard]] std::size_t size() const;
    /// Those of a start: derivatives by it are the identity, all others 0.
    [[nodiscard]] std::vector<double> from(const double* state) const;

    void operator()(const std::vector<double>& y, std::vector<double>& slope, double s);

    /// Derivatives at a fixed time in the place of a fixed phase: what omega changes by moving the phase that belongs
    /// to the time. X and W of y become those of x(t) at t = s / omega; nothing changes unless omega is free.
    void at_fixed_time(std::vector<double>& y, double s);

private:
    void evaluate(const std::vector<double>& y, double s);
    void differentiate_twice(const std::vector<double>& y, double s);
    [[nodiscard]] const double* column(const std::vector<double>& y, std::size_t j) const { return &y[n_ + j * n_]; }
    [[nodiscard]] std::size_t second(std::size_t i, std::size_t j) const { return n_ * (1 + d_ + i * d_ + j); }

    const Kernel& kernel_;
    FlowStart start_;
    std::vector<std::ptrdiff_t> free_;
    int order_;
    std::size_t n_, d_;
    std::optional<double> omega_;         ///< of a forced model
    std::optional<std::size_t> turning_;  ///< the direction of omega
    std::vector<double> g_;               ///< n
    std::vector<double> gradient_;        ///< n x d: g by all directions, at a fixed phase
    std::vector<double> curvature_;       ///< n x (d d): g_ab
    std::vector<double> by_phase_;        ///< n: f by the phase
    std::vector<double> half_;            ///< n x (d d): g_ab with b along direction j, column a d + j
};

}  // namespace orbid::models
