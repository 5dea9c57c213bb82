#pragma once

#include <algorithm>
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
    VariationalEquations(const Kernel& kernel, const FlowStart& start, std::span<const std::ptrdiff_t> free, int order)
        : kernel_(kernel),
          start_(start),
          free_(free.begin(), free.end()),
          order_(order),
          n_(kernel.coordinates().size()),
          d_(n_ + free.size()),
          g_(n_) {
        if (const auto frequency = kernel.forcing_frequency()) {
            omega_ = start.theta[*frequency];
            const auto place = std::find(free_.begin(), free_.end(), static_cast<std::ptrdiff_t>(*frequency));
            if (place != free_.end()) turning_ = n_ + static_cast<std::size_t>(place - free_.begin());
        }
        if (order_ > 0) gradient_.resize(n_ * d_);
        if (order_ > 1) {
            curvature_.resize(n_ * d_ * d_);
            half_.resize(n_ * d_ * d_);
            by_phase_.resize(n_);
        }
    }

    [[nodiscard]] bool forced() const { return omega_.has_value(); }
    /// Numbers of the layout above.
    [[nodiscard]] std::size_t size() const {
        return order_ == 0 ? n_ : order_ == 1 ? n_ * (1 + d_) : n_ * (1 + d_ + d_ * d_);
    }
    /// Those of a start: derivatives by it are the identity, all others 0.
    [[nodiscard]] std::vector<double> from(const double* state) const {
        std::vector<double> y(size());
        std::copy(state, state + n_, y.begin());
        for (std::size_t j = 0; order_ > 0 && j < n_; ++j)
            y[n_ + j * n_ + j] = 1.0;
        return y;
    }

    void operator()(const std::vector<double>& y, std::vector<double>& slope, double s) {
        evaluate(y, s);
        std::fill(slope.begin(), slope.end(), 0.0);
        std::copy(g_.begin(), g_.end(), slope.begin());
        if (order_ == 0) return;
        for (std::size_t j = 0; j < d_; ++j) {
            double* to = &slope[n_ + j * n_];
            for (std::size_t k = 0; k < n_; ++k)
                add(n_, column(y, j)[k], &gradient_[k * n_], to);
            if (j >= n_) add(n_, 1.0, &gradient_[j * n_], to);
        }
        if (order_ == 1) return;
        std::fill(half_.begin(), half_.end(), 0.0);
        for (std::size_t a = 0; a < d_; ++a)
            for (std::size_t j = 0; j < d_; ++j) {
                double* to = &half_[(a * d_ + j) * n_];
                for (std::size_t b = 0; b < n_; ++b)
                    add(n_, column(y, j)[b], &curvature_[(a * d_ + b) * n_], to);
                if (j >= n_) add(n_, 1.0, &curvature_[(a * d_ + j) * n_], to);
            }
        for (std::size_t i = 0; i < d_; ++i)
            for (std::size_t j = 0; j <= i; ++j) {
                double* to = &slope[second(i, j)];
                for (std::size_t k = 0; k < n_; ++k)
                    add(n_, y[second(i, j) + k], &gradient_[k * n_], to);
                for (std::size_t a = 0; a < n_; ++a)
                    add(n_, column(y, i)[a], &half_[(a * d_ + j) * n_], to);
                if (i >= n_) add(n_, 1.0, &half_[(i * d_ + j) * n_], to);
                if (i != j) std::copy_n(to, n_, &slope[second(j, i)]);
            }
    }

    /// Derivatives at a fixed time in the place of a fixed phase: what omega changes by moving the phase that belongs
    /// to the time. X and W of y become those of x(t) at t = s / omega; nothing changes unless omega is free.
    ///
    /// x(t; theta) = x(tau; theta) at tau = omega t, T = s / omega the time since the start:
    ///     x_i  -> X_i + [i = omega] T g
    ///     x_ij -> W_ij + [i = omega] T G_j + [j = omega] T G_i + [i = j = omega] T^2 (g_x g + g_tau)
    /// with G_j = g_x X_j + g_j.
    void at_fixed_time(std::vector<double>& y, double s) {
        if (!turning_ || order_ == 0) return;
        const std::size_t w = *turning_;
        const double time = s / *omega_;
        evaluate(y, s);
        if (order_ > 1) {
            std::vector<double> along(n_);
            for (std::size_t j = 0; j < d_; ++j) {
                std::fill(along.begin(), along.end(), 0.0);
                for (std::size_t k = 0; k < n_; ++k)
                    add(n_, column(y, j)[k], &gradient_[k * n_], along.data());
                if (j >= n_) add(n_, 1.0, &gradient_[j * n_], along.data());
                add(n_, time, along.data(), &y[second(w, j)]);
                add(n_, time, along.data(), &y[second(j, w)]);
            }
            for (std::size_t k = 0; k < n_; ++k)
                add(n_, time * time * g_[k], &gradient_[k * n_], &y[second(w, w)]);
            add(n_, time * time / *omega_, by_phase_.data(), &y[second(w, w)]);
        }
        add(n_, time, g_.data(), &y[n_ + w * n_]);
    }

private:
    /// to += factor from, n numbers.
    static void add(std::size_t n, double factor, const double* from, double* to) {
        for (std::size_t i = 0; i < n; ++i)
            to[i] += factor * from[i];
    }
    /// g and its derivatives, of f and those of f:
    ///     g_a  = f_a / omega - [a = omega] f / omega^2
    ///     g_ab = f_ab / omega - ([a = omega] f_b + [b = omega] f_a) / omega^2 + [a = b = omega] 2 f / omega^3
    void evaluate(const std::vector<double>& y, double s) {
        const double phase = omega_ ? start_.phase + s : 0.0;
        const double rate = omega_ ? 1.0 / *omega_ : 1.0;
        kernel_.rhs(phase, y.data(), start_.theta, nullptr, g_.data());
        if (order_ > 0) kernel_.rhs_derivatives(phase, y.data(), start_.theta, nullptr, free_, gradient_.data());
        if (order_ > 1) {
            kernel_.rhs_second_derivatives(phase, y.data(), start_.theta, nullptr, free_, curvature_.data(),
                                           by_phase_.data());
            for (double& value : curvature_)
                value *= rate;
            for (std::size_t a = 0; turning_ && a < d_; ++a) {
                add(n_, -rate * rate, &gradient_[a * n_], &curvature_[(a * d_ + *turning_) * n_]);
                add(n_, -rate * rate, &gradient_[a * n_], &curvature_[(*turning_ * d_ + a) * n_]);
            }
            if (turning_) add(n_, 2.0 * rate * rate * rate, g_.data(), &curvature_[(*turning_ * d_ + *turning_) * n_]);
        }
        for (double& value : gradient_)
            value *= rate;
        if (turning_ && order_ > 0) add(n_, -rate * rate, g_.data(), &gradient_[*turning_ * n_]);
        for (double& value : g_)
            value *= rate;
    }
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
