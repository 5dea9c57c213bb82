#pragma once

#include <cmath>

namespace orbid::estimator {

/// Finds the step at which the mean acceptance meets its target, from a noisy acceptance per iteration.
///
///     H_m = (1 - 1/(m + t0)) H_{m-1} + (target - acceptance_m) / (m + t0)
///     ln step_m = mu - sqrt(m) / gamma H_m,      mu = ln(10 first step)
///     ln averaged_m = m^-kappa ln step_m + (1 - m^-kappa) ln averaged_{m-1}
///
/// with gamma = 0.05, t0 = 10, kappa = 0.75. Source: Hoffman and Gelman (2014), section 3.2.1 and algorithm 5.
class DualAveraging {
public:
    /// @param step  first guess, > 0.   @param target  wanted mean acceptance, in (0, 1).
    DualAveraging(double step, double target) : target_(target) { restart(step); }

    /// Forgets everything but the target.
    void restart(double step) {
        // Early steps are drawn to ten times the guess: too long a step is detected sooner than too short a one.
        mu_ = std::log(10.0 * step);
        ln_step_ = std::log(step);
        ln_averaged_ = 0.0;
        error_ = 0.0;
        count_ = 0;
    }

    /// @param acceptance  of the iteration made with step(), in [0, 1].
    void observe(double acceptance) {
        constexpr double gamma = 0.05;
        constexpr double t0 = 10.0;
        constexpr double kappa = 0.75;
        ++count_;
        const double m = count_;
        const double weight = 1.0 / (m + t0);
        error_ = (1.0 - weight) * error_ + weight * (target_ - acceptance);
        ln_step_ = mu_ - std::sqrt(m) / gamma * error_;
        const double share = std::pow(m, -kappa);
        ln_averaged_ = share * ln_step_ + (1.0 - share) * ln_averaged_;
    }

    [[nodiscard]] double step() const { return std::exp(ln_step_); }
    /// The step to keep afterwards; step() before any observation.
    [[nodiscard]] double averaged() const { return count_ > 0 ? std::exp(ln_averaged_) : step(); }

private:
    double target_;
    double mu_ = 0.0;
    double ln_step_ = 0.0;
    double ln_averaged_ = 0.0;
    double error_ = 0.0;
    int count_ = 0;
};

}  // namespace orbid::estimator
