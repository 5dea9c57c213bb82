#include "estimator/minimisation/trust_region.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace orbid::estimator {

void stretch(TrialStep& step, double factor) {
    if (std::any_of(step.parameters.active.begin(), step.parameters.active.end(), [](int side) { return side != 0; }))
        return;
    step.parameters.d *= factor;
    step.parameters.seen *= factor;
    for (Eigen::VectorXd& d_z : step.latents)
        d_z *= factor;
    step.slope *= factor;
    step.curvature *= factor * factor;
    step.length *= std::abs(factor);
}

TrialStep step_at(const StepModel& model, double mu) {
    const ReducedProblem reduced_problem = condense(*model.arrow, mu);
    return step_with(model, reduced_problem,
                     bounded_step(reduced_problem, *model.prior, model.bounds, mu, model.damping, model.fallback,
                                  model.rank_tolerance),
                     mu);
}

TrialStep step_with(const StepModel& model, const ReducedProblem& reduced_problem, BoundedStep parameters, double mu) {
    TrialStep step;
    step.mu = mu;
    step.parameters = std::move(parameters);
    const Eigen::VectorXd& d = step.parameters.d;
    step.latents = latent_steps(*model.arrow, reduced_problem, d);
    const ModelChange change = model_change(*model.arrow, d, step.latents);
    step.slope = change.linear + model.prior->gradient.dot(d);
    step.curvature = change.quadratic + model.prior->quadratic(d);
    // Directions that only the prior decides are measured in its own curvature, as they are damped.
    double square = model.damping.cwiseProduct(step.parameters.seen).squaredNorm() +
                    model.prior->quadratic(d - step.parameters.seen);
    double latent_square = 0.0;
    for (std::size_t b = 0; b < step.latents.size(); ++b)
        if (model.arrow->spread.owns(b))
            latent_square += model.arrow->blocks[b].norm.cwiseProduct(step.latents[b]).squaredNorm();
    square += model.arrow->spread.sum(latent_square);
    step.length = std::sqrt(square);
    return step;
}

TrialStep step_within(const StepModel& model, const TrialStep& full, double radius) {
    constexpr double slack = 0.1;
    TrialStep step = full;
    if (step.length <= (1.0 + slack) * radius) return step;
    // 1 / length is nearly linear in mu: secants on it, kept inside the bracket.
    double low = 0.0;
    double high = std::numeric_limits<double>::infinity();
    double low_inverse = 1.0 / step.length;
    double mu = std::min(1e-3 * step.length / radius, 1e30);
    constexpr int limit = 40;
    for (int iteration = 0; iteration < limit; ++iteration) {
        step = step_at(model, mu);
        if (std::abs(step.length - radius) <= slack * radius) break;
        const double slope = (1.0 / step.length - low_inverse) / (mu - low);
        if (step.length > radius) {
            low = mu;
            low_inverse = 1.0 / step.length;
            const double secant = slope > 0.0 ? mu + (1.0 / radius - low_inverse) / slope : 10.0 * mu;
            mu = std::clamp(secant, 1.2 * mu, 1000.0 * mu);
        } else {
            high = mu;
            mu = slope > 0.0 ? low + (1.0 / radius - low_inverse) / slope : 0.5 * (low + high);
        }
        if (!(mu < high) || !(mu > low)) mu = low > 0.0 ? std::sqrt(low * high) : 0.1 * high;
        // A step on a bound may jump across the radius: the shorter side is accepted.
        if (high < (1.0 + 1e-6) * low) {
            step = step_at(model, high);
            break;
        }
    }
    return step;
}

}  // namespace orbid::estimator
