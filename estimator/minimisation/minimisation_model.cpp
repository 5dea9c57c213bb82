#include <algorithm>
#include <cmath>
#include <string>

#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

namespace {

/// An estimate of fewer blocks takes well below a second whatever is done.
constexpr std::size_t many_blocks = 1000;

}  // namespace

double Minimisation::objective() const {
    double value = value_ + 0.5 * set_.ln_det_shapes + minimum_.prior.value;
    const double weight = 1.0 / (minimum_.matching * minimum_.matching);
    for (const BlockRows& block : minimum_.rows)
        if (block.link.size() > 0) value += 0.5 * weight * block.link.rightCols(1).squaredNorm();
    return value;
}

void Minimisation::factorise_errors() {
    WhitenedArrow standard = standard_arrow(minimum_.rows, problem_.laws, state_.psi, minimum_.matching, curvature());
    arrow_ = std::move(standard.arrow);
    value_ = standard.value;
}

void Minimisation::set_model() {
    const Eigen::VectorXd fallback = sizes(problem_, state_.theta);
    const ReducedProblem reduced_problem = condense(arrow_, 0.0);
    Eigen::VectorXd norm = reduced_problem.r.colwise().norm().transpose();
    for (Eigen::Index i = 0; i < norm.size(); ++i)
        if (!(norm[i] > 0.0)) norm[i] = 1.0 / fallback[i];
    model_.damping = model_.damping.size() == norm.size() ? Eigen::VectorXd(model_.damping.cwiseMax(norm)) : norm;
    model_.arrow = &arrow_;
    model_.prior = &minimum_.prior;
    model_.bounds = {lower_ - state_.u, upper_ - state_.u};
    model_.fallback = fallback;
    model_.rank_tolerance = problem_.options.relative_singular_value;
    minimum_.step = bounded_step(reduced_problem, minimum_.prior, model_.bounds, 0.0, model_.damping, fallback,
                                 model_.rank_tolerance);
    model_length_ = (reduced_problem.r * minimum_.step.d).norm();
    full_known_ = false;
}

/// The full step of the model, with the latent states.
const TrialStep& Minimisation::full_step() {
    if (!full_known_) full_ = step_at(model_, 0.0);
    full_known_ = true;
    return full_;
}

bool Minimisation::update_errors(bool profile) {
    factorise_errors();
    set_model();
    if (set_.provisional) follow_scales();
    const std::vector<bool> free = free_errors(problem_, set_);
    if (std::find(free.begin(), free.end(), true) == free.end()) return true;
    Eigen::Index dead = 0;
    for (const BlockTriangle& block : arrow_.blocks)
        dead += std::count(block.dead.begin(), block.dead.end(), true);
    const Eigen::Index taken = set_.latents - dead - set_.constraints + minimum_.step.space.data.cols();
    if (set_.records <= taken) {
        conclude(Outcome::no_freedom, std::to_string(set_.records) + " records cannot determine " +
                                          std::to_string(taken) +
                                          " parameters and latent states and an error scale as well");
        return false;
    }
    if (without_covariance()) return false;
    for (std::size_t i = 0; i < minimum_.step.active.size(); ++i)
        if (minimum_.step.active[i] != 0 && minimum_.step.d[static_cast<Eigen::Index>(i)] != 0.0) profile = false;
    const ErrorProblem errors = error_problem(problem_, set_, minimum_, profile ? Follow::all : Follow::latents);
    const ErrorLimits limit = limits();
    rounding_ = limit.rounding;
    // Scales of long data need not be better than the parameters, which have this far to go; while that is far the next
    // step repeats the search. Short data are always searched to the end. That costs nothing, and the likelihood of two
    // scales may have another minimum nearby, where one of them is zero.
    ErrorSearch search;
    if (set_.blocks.size() >= many_blocks) {
        search.tolerance = std::clamp(1e-3 * model_length_, 1e-12, 1e-2);
        search.known = &curvature_;
        if (model_length_ > 1e-2 && set_.constraints == 0) search.untried = 0.1;
    }
    const ErrorMinimum found = minimise_errors(errors, state_.psi, limit.floor, limit.ceiling, search);
    if (found.steps > 0)
        ledger_.history.push_back(
            {ledger_.round, "scales", true, found.before, found.after, 0.0, "", set_.provisional});
    minimum_.error_at_floor = found.at_floor;
    minimum_.error_at_ceiling = found.at_ceiling;
    const Eigen::VectorXd psi =
        problem_.options.variance == Variance::integrated ? integrated_scales(errors, found) : found.psi;
    if (psi == state_.psi) return true;
    rescale([&] { state_.psi = psi; });
    return !without_covariance();
}

/// In intermediate stages scales without a start take one step of expectation and maximisation per stage: s^2 = [e^T e
/// + tr(J C J^T)] / n of (M10). Where continuity is loose the data do not determine them and they stay. They approach
/// their own values as it tightens. At their minimum they would go to zero instead, for loose continuity alone can
/// explain everything.
void Minimisation::follow_scales() {
    if (state_.errors_known || accepted_ > 0 || ledger_.round <= 1) return;
    ErrorProblem errors = error_problem(problem_, set_, minimum_, Follow::latents);
    bool any = false;
    for (std::size_t k = 0; k < problem_.errors.size(); ++k) {
        errors.free[k] = problem_.errors[k].start_unknown() && problem_.errors[k].estimate;
        any = any || errors.free[k];
    }
    if (!any) return;
    const ErrorPoint point = evaluate_errors(errors, state_.psi);
    Eigen::VectorXd psi = state_.psi;
    for (const NoiseModel& law : problem_.laws) {
        const Eigen::Index k = law.first;
        const double count = set_.count[law.channels.front()];
        if (!errors.free[static_cast<std::size_t>(k)] || !law.compressible() || !(count > 0.0)) continue;
        psi[k] += 0.5 * std::log(std::max((point.fit[k] + count - point.left[k]) / count, 1e-290));
        psi[k] = std::clamp(psi[k], law.coordinates.front().lower, law.coordinates.front().upper);
    }
    if (psi != state_.psi) rescale([&] { state_.psi = psi; });
}

/// Whether a full covariance cannot be estimated; the outcome then gives the reason.
bool Minimisation::without_covariance() {
    const std::string reason = why_no_covariance(problem_, set_, state_.psi, minimum_.step.space.data.cols());
    if (!reason.empty()) conclude(Outcome::no_freedom, reason);
    return !reason.empty();
}

/// Damping and radius are kept in units of the standardised problem, which `change` changes.
void Minimisation::rescale(const std::function<void()>& change) {
    const Eigen::VectorXd before = condense(arrow_, 0.0).r.colwise().norm();
    change();
    factorise_errors();
    const Eigen::VectorXd after = condense(arrow_, 0.0).r.colwise().norm();
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

/// The next stage of the constraints, when this one has little left to give (or `at_once`).
/// @return whether there was one
bool Minimisation::tighten(bool at_once) {
    if (set_.constraints == 0 || !(minimum_.matching > exact_matching)) return false;
    // Short steps do not show how far this stage is from its end.
    if (!at_once && (!last_step_full_ || !(last_decrease_ < 0.05 * last_objective_))) return false;
    rescale([this] { minimum_.matching = std::max(exact_matching, tightening * minimum_.matching); });
    curvature_ = {};
    stage_trials_ = 0;
    if (minimum_.matching < tight_matching) {
        lower_ = problem_.lower;
        upper_ = problem_.upper;
    }
    factorise_errors();
    set_model();
    radius_ = std::max(radius_, initial_radius());
    return true;
}

/// The first step may change every parameter by about its own size (a factor e in log coordinates). Latent states do
/// not count: with many of them a parameter could go anywhere. Without parameters they limit the step instead.
double Minimisation::initial_radius() const {
    if (model_.damping.size() > 0) return model_.damping.cwiseProduct(sizes(problem_, state_.theta)).norm();
    double radius = 0.0;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        const Eigen::VectorXd& norm = arrow_.blocks[b].norm;
        const Eigen::VectorXd& z = state_.latents[set_.blocks[b].residual][set_.blocks[b].block];
        radius =
            std::hypot(radius, norm.cwiseProduct(z.cwiseAbs().cwiseMax(Eigen::VectorXd::Ones(norm.size()))).norm());
    }
    return radius;
}

}  // namespace orbid::estimator
