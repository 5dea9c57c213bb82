#include <cmath>

#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

double Minimisation::objective() const {
    double value = standard_.value + 0.5 * set_.ln_det_shapes + minimum_.prior.value;
    if (set_.constraints == 0) return value;
    double square = 0.0;
    for (const BlockRows& block : minimum_.rows)
        if (block.link.size() > 0) square += block.link.rightCols(1).squaredNorm();
    return value + 0.5 * set_.spread.sum(square) / (minimum_.matching * minimum_.matching);
}

/// Half the sum of squares of whitened residuals and constraints.
double Minimisation::misfit() const {
    double square = 0.0;
    for (const BlockTriangle& block : standard_.arrow.blocks) {
        square += block.triangle.rightCols(1).squaredNorm();
        if (block.link.size() > 0) square += block.link.rightCols(1).squaredNorm();
    }
    return 0.5 * set_.spread.sum(square);
}

/// What is factorised is not kept beside what takes its place. The reduced problem of the parameters stays.
void Minimisation::drop_factors() {
    full_.reset();
    standard_ = {};
    reduced_.drop_blocks();
}

void Minimisation::factorise_errors() {
    drop_factors();
    take_factor(
        standard_arrow(set_, minimum_.rows, problem_.laws, state_.psi, minimum_.matching, curvature(), one_curvature_));
}

/// Factorises again with the curvature that only steps see; error parameters are estimated without it.
void Minimisation::factorise_steps() {
    if (excess_.of_blocks().empty()) return;
    for (const auto& [b, excess] : excess_.of_blocks())
        minimum_.rows[b].excess = excess;
    factorise_errors();
    for (const auto& [b, excess] : excess_.of_blocks())
        minimum_.rows[b].excess = 0.0;
    set_model();
}

void Minimisation::take_factor(WhitenedArrow standard) {
    standard_ = std::move(standard);
    reduced_ = condense(standard_.arrow, 0.0);
}

void Minimisation::set_model() {
    const Eigen::VectorXd fallback = sizes(problem_, state_.theta);
    Eigen::VectorXd norm = reduced_.r.colwise().norm().transpose();
    for (Eigen::Index i = 0; i < norm.size(); ++i)
        if (!(norm[i] > 0.0)) norm[i] = 1.0 / fallback[i];
    model_.damping = model_.damping.size() == norm.size() ? Eigen::VectorXd(model_.damping.cwiseMax(norm)) : norm;
    model_.arrow = &standard_.arrow;
    model_.prior = &minimum_.prior;
    model_.bounds = {stages_.lower() - state_.u, stages_.upper() - state_.u};
    model_.fallback = fallback;
    model_.rank_tolerance = problem_.options.relative_singular_value;
    minimum_.step =
        bounded_step(reduced_, minimum_.prior, model_.bounds, 0.0, model_.damping, fallback, model_.rank_tolerance);
    model_length_ = (reduced_.r * minimum_.step.d).norm();
    full_.reset();
}

/// The full step of the model, with the latent states.
const TrialStep& Minimisation::full_step() {
    if (!full_) full_ = step_with(model_, reduced_, minimum_.step, 0.0);
    return *full_;
}

/// Damping and radius are kept in units of the standardised problem, which `change` changes and factorises.
void Minimisation::rescale(const std::function<void()>& change) {
    const Eigen::VectorXd before = reduced_.r.colwise().norm();
    change();
    const Eigen::VectorXd after = reduced_.r.colwise().norm();
    double old_size = 0.0;
    double new_size = 0.0;
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    for (Eigen::Index i = 0; i < before.size(); ++i) {
        if (!(before[i] > 0.0) || !(after[i] > 0.0)) continue;
        old_size = std::hypot(old_size, model_.damping[i] * size[i]);
        model_.damping[i] *= after[i] / before[i];
        new_size = std::hypot(new_size, model_.damping[i] * size[i]);
    }
    if (old_size > 0.0) radius_ *= new_size / old_size;
    set_model();
}

/// The first step may change every parameter by about its own size (a factor e in log coordinates). Latent states do
/// not count: with many of them a parameter could go anywhere. Without parameters they limit the step instead.
double Minimisation::initial_radius() const {
    if (model_.damping.size() > 0) return model_.damping.cwiseProduct(sizes(problem_, state_.theta)).norm();
    double square = 0.0;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        if (!set_.spread.owns(b)) continue;
        const Eigen::VectorXd& norm = standard_.arrow.blocks[b].norm;
        const Eigen::VectorXd& z = state_.latents[set_.blocks[b].residual][set_.blocks[b].block];
        square += norm.cwiseProduct(z.cwiseAbs().cwiseMax(Eigen::VectorXd::Ones(norm.size()))).squaredNorm();
    }
    return std::sqrt(set_.spread.sum(square));
}

}  // namespace orbid::estimator
