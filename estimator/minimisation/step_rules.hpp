#pragma once

#include <algorithm>

namespace orbid::estimator {

/// Lengths of steps, in posterior sds, at which both minimisers change how they go on.

/// Only this close to the minimum are steps extended by the factor that the last one gave.
inline constexpr double stretched_within_sds = 1.0;
/// Plain least squares: from here on corrections of second order do not pay for their evaluation.
inline constexpr double curved_sds = 0.05;
/// Latent states: shorter steps are judged by gradients. Computed orbits carry rounding of up to 1e-6 sds of their
/// targets. That hides the 5e-7 that a step of 1e-3 gains, and is a fiftieth of the 5e-5 of a step of 1e-2.
inline constexpr double gradient_judged_sds = 1e-2;
/// Steps that were rejected are judged by gradients below this many of the least changes that residuals can show.
inline constexpr double hidden_roundings = 100.0;
/// A thousandth of a sd changes no reported figure. Where nothing shorter decreases Phi, rounding is reached; plain
/// least squares judges its steps from here on by the length of what is left.
inline constexpr double rounding_sds = 1e-3;
/// With more than this left an estimate has not converged, whatever stops it: a tenth of a sd moves an interval
/// visibly.
inline constexpr double converged_sds = 0.1;
/// Steps continue while they gain digits, but not below this length.
inline constexpr double polished_sds = 1e-10;

/// Least actual over predicted decrease for a step to count: a ten-thousandth is the usual least gain that still proves
/// convergence. Plain least squares is stricter, for there more damping costs no derivatives.
inline constexpr double least_gain = 1e-4;
inline constexpr double least_plain_gain = 1e-3;

/// Near the minimum Gauss-Newton steps keep their direction and are too long or too short by the same factor each time
/// (Hartley's interpolation, applied to the next step).
[[nodiscard]] inline double stretch_of_next(double best_length) {
    return std::clamp(best_length, 0.4, 2.5);
}

/// An accepted step.
struct StepTaken {
    double gain = 0.0;      ///< actual over predicted decrease
    double decrease = 0.0;  ///< of the objective
    double misfit = 0.0;    ///< half the sum of squares of whitened residuals and constraints before it
    bool full = false;      ///< not shortened by the trust region
};

}  // namespace orbid::estimator
