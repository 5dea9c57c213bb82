#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/problem/bounded_step.hpp"

namespace orbid::estimator {

/// A step of all parameters and latent states, with the prediction of the quadratic model.
struct TrialStep {
    BoundedStep parameters;
    std::vector<Eigen::VectorXd> latents;  ///< per active block
    double mu = 0.0;
    double length = 0.0;     ///< in the metric of the trust region
    double slope = 0.0;      ///< directional derivative of Phi at the start, < 0
    double curvature = 0.0;  ///< second derivative of the model along the step
    [[nodiscard]] double predicted_decrease() const { return -slope - 0.5 * curvature; }
};

/// The quadratic model of Phi at fixed scales, and the metric in which steps are limited.
struct StepModel {
    const BlockArrow* arrow = nullptr;
    const PriorModel* prior = nullptr;
    StepBounds bounds;
    Eigen::VectorXd damping;   ///< D of (M11), shape (q)
    Eigen::VectorXd fallback;  ///< see split()
    double rank_tolerance = 0.0;
};

/// Makes the step `factor` times as long, unless it rests on a bound.
void stretch(TrialStep& step, double factor);

/// The step damped by mu.
[[nodiscard]] TrialStep step_at(const StepModel& model, double mu);
/// The same with what is computed already: the condensed problem, and the step of the parameters.
[[nodiscard]] TrialStep step_with(const StepModel& model, const ReducedProblem& reduced_problem, BoundedStep parameters,
                                  double mu);

/// The step whose length is at most about `radius` (within a tenth), by a suitable damping mu; the full step when that
/// is short enough. @param full  step_at(model, 0).
[[nodiscard]] TrialStep step_within(const StepModel& model, const TrialStep& full, double radius);

}  // namespace orbid::estimator
