#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "estimator/minimisation/gradient_bundle.hpp"
#include "estimator/minimisation/minimisation.hpp"

namespace orbid::estimator {

namespace {

/// Pieces are those within this many posterior sds of the point: what is reported cannot tell them from it.
constexpr double near_sds = 1e-3;
/// A piece that falls at this share of the slope that was expected is not new.
constexpr double falling_share = 0.5;
/// Beyond a jump no more than this is lost: the estimate is as good as its sds say.
constexpr double left_beyond_jump = 1.0;
/// More pieces than this do not meet where four friction parameters were estimated; each costs an evaluation.
constexpr Eigen::Index most_pieces = 12;
/// Steps off kinks that one minimisation takes; each is followed by ordinary ones.
constexpr int most_kinks = 50;
/// The Hessian is formed as a whole: parameters and latent states together.
constexpr Eigen::Index most_unknowns = 64;
/// Blocks hold up all others where they have nearly all of what is left, and are few among all. As many are held as
/// have all of it but this little.
constexpr double nearly_all = 0.9, little = 1e-3, few = 0.01;
/// Share of all blocks that are held at most, neighbours included.
constexpr double most_held = 0.03;
/// Runs of them may have gaps.
constexpr std::size_t longest_gap = 4;

TrialStep scaled(TrialStep step, double factor) {
    stretch(step, factor);
    return step;
}

/// Blocks in order and as many before and after each run of them: where one course lies at a kink, it does so for long.
std::vector<std::size_t> with_neighbours(const std::vector<std::size_t>& blocks, std::size_t all) {
    std::vector<std::size_t> result;
    for (std::size_t i = 0; i < blocks.size();) {
        std::size_t last = i;
        while (last + 1 < blocks.size() && blocks[last + 1] <= blocks[last] + longest_gap)
            ++last;
        const std::size_t length = blocks[last] + 1 - blocks[i];
        const std::size_t first = blocks[i] - std::min(blocks[i], length);
        const std::size_t end = std::min(blocks[last] + 1 + length, all);
        for (std::size_t b = result.empty() ? first : std::max(first, result.back() + 1); b < end; ++b)
            result.push_back(b);
        i = last + 1;
    }
    return result;
}

}  // namespace

/// Parameters that rest on no bound, then all latent states, as one vector; and back, as a step.
Eigen::Index Minimisation::unknowns() const {
    return std::ssize(minimum_.step.free) + set_.latents;
}

TrialStep Minimisation::step_of(const Eigen::VectorXd& p) {
    TrialStep step = full_step();
    step.mu = 1.0;  // no full step of a quadratic model: the next one is not stretched by it
    // Its ends are kept within the bounds, without resting on them.
    step.parameters.active.assign(step.parameters.active.size(), 0);
    step.parameters.d.setZero();
    Eigen::Index at = 0;
    for (const Eigen::Index i : minimum_.step.free)
        step.parameters.d[i] = p[at++];
    for (Eigen::VectorXd& z : step.latents) {
        z = p.segment(at, z.size());
        at += z.size();
    }
    step.length = model_.damping.cwiseProduct(step.parameters.d).norm();
    return step;
}

/// Gradient of the objective where it has these rows, by the unknowns.
Eigen::VectorXd Minimisation::gradient_of(const std::vector<BlockRows>& rows, const PriorModel& prior) {
    const BlockArrow arrow =
        standard_arrow(rows, problem_.laws, state_.psi, minimum_.matching, curvature(), false, false, set_.spread)
            .arrow;
    Eigen::VectorXd gradient(unknowns());
    for (Eigen::Index i = 0; i < gradient.size(); ++i) {
        const TrialStep unit = step_of(Eigen::VectorXd::Unit(gradient.size(), i));
        gradient[i] =
            model_change(arrow, unit.parameters.d, unit.latents).linear + prior.gradient.dot(unit.parameters.d);
    }
    return gradient;
}

/// Curvature of the model at the state, by the unknowns.
Eigen::MatrixXd Minimisation::hessian() {
    const Eigen::Index n = unknowns();
    const auto along = [&](const Eigen::VectorXd& p) {
        const TrialStep step = step_of(p);
        return model_change(standard_.arrow, step.parameters.d, step.latents).quadratic +
               minimum_.prior.quadratic(step.parameters.d);
    };
    Eigen::MatrixXd result(n, n);
    for (Eigen::Index i = 0; i < n; ++i)
        result(i, i) = along(Eigen::VectorXd::Unit(n, i));
    // In units of the diagonal, so that the products do not cancel.
    for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j < i; ++j) {
            const double a = result(i, i) > 0.0 ? 1.0 / std::sqrt(result(i, i)) : 1.0;
            const double b = result(j, j) > 0.0 ? 1.0 / std::sqrt(result(j, j)) : 1.0;
            const Eigen::VectorXd p = a * Eigen::VectorXd::Unit(n, i) + b * Eigen::VectorXd::Unit(n, j);
            const double both = along(p) - a * a * result(i, i) - b * b * result(j, j);
            result(i, j) = result(j, i) = 0.5 * both / (a * b);
        }
    }
    return result;
}

/// Tries a step that decreases all pieces. @return whether it was taken
bool Minimisation::step_along_kink(const TrialStep& step) {
    const double length = std::sqrt(step.curvature);
    for (double factor = 1.0; factor * length > near_sds; factor *= 0.25) {
        const TrialStep shorter = scaled(step, factor);
        derivatives_at_trial_ = false;
        ++ledger_.trials;
        const double before = objective();
        Trial trial = evaluated(shorter);
        trial.gain = -trial.change / (factor * step.curvature);
        const bool accepted = decreases(trial);
        ledger_.history.push_back({ledger_.round, StepBlock::theta, accepted, before,
                                   accepted ? before + trial.change : before, shorter.mu, trial.reason,
                                   set_.provisional});
        if (!accepted) continue;
        const double radius = radius_;
        adopt(shorter, std::move(trial), misfit());
        radius_ = std::max(radius, shorter.length);
        return true;
    }
    return false;
}

/// A jump rises at once by what any longer step cannot win back, wrong derivatives in proportion to the step.
Minimisation::Kink Minimisation::examine_jump(const TrialStep& step) {
    const double length = std::sqrt(step.curvature);
    derivatives_at_trial_ = false;
    const double rise = evaluated(scaled(step, near_sds / length)).change;
    const double nearer = evaluated(scaled(step, 0.0625 * near_sds / length)).change;
    if (!(minimum_.remaining < left_beyond_jump) || !(nearer > 0.5 * rise) || !(rise < infinity)) return Kink::none;
    minimum_.kink = true;
    conclude(Outcome::converged, "the objective jumps by " + two_figures(rise) +
                                     " where it is least: the full step, which would cross the jump, is " +
                                     two_figures(minimum_.remaining) + " posterior sds");
    return Kink::minimum;
}

Minimisation::Kink Minimisation::examine_kink() {
    const Eigen::MatrixXd curvature = hessian();
    GradientBundle bundle(curvature);
    bundle.add(gradient_of(minimum_.rows, minimum_.prior));
    while (bundle.size() < most_pieces) {
        const Eigen::VectorXd p = bundle.step();
        TrialStep step = step_of(p);
        step.curvature = p.dot(curvature * p);
        step.slope = -step.curvature;
        const double length = std::sqrt(step.curvature);
        if (bundle.size() > 1 && length < near_sds) {
            minimum_.remaining = length;
            minimum_.kink = true;
            conclude(Outcome::converged, "the minimum lies at a kink of the objective, where " +
                                             std::to_string(bundle.size()) +
                                             " smooth pieces meet; the step that decreases all of them is " +
                                             two_figures(length) + " posterior sds");
            return Kink::minimum;
        }
        if (!(length > 0.0)) return Kink::none;
        if (bundle.size() > 1 && step_along_kink(step)) return Kink::left;
        derivatives_at_trial_ = true;
        const Trial trial = evaluated(scaled(step, near_sds / length));
        if (!trial.slopes_compared) return Kink::none;
        const Eigen::VectorXd gradient = gradient_of(
            linearise(set_, problem_.laws, trial.evaluation.values, problem_.coordinates, trial.state.theta),
            trial.prior);
        // The same piece as before, which falls where the objective does not: it jumps, or the derivatives are wrong.
        if (gradient.dot(p) < falling_share * step.slope) return examine_jump(step);
        bundle.add(gradient);
    }
    return Kink::none;
}

/// Where no step decreases the objective: whether it has a kink there. @return true: go on
bool Minimisation::passes_kink() {
    if (kinks_++ >= most_kinks || set_.provisional || !set_.spread.alone() || unknowns() > most_unknowns) return false;
    const Kink found = examine_kink();
    if (found == Kink::left) {
        stopping_.expect_kinks(true);
        return after_step();
    }
    return found == Kink::none && stopping_.expect_kinks(false);
}

/// The blocks where nearly all of the full step's square is left, with their neighbours, if they are few.
std::vector<std::size_t> Minimisation::few_that_move() {
    const TrialStep& full = full_step();
    std::vector<Eigen::VectorXd> back = full.latents;
    for (Eigen::VectorXd& z : back)
        z = -z;
    // What is linear in the step cancels.
    std::vector<double> square = model_changes(standard_.arrow, full.parameters.d, full.latents);
    const std::vector<double> backwards = model_changes(standard_.arrow, -full.parameters.d, back);
    for (std::size_t b = 0; b < square.size(); ++b)
        square[b] += backwards[b];
    std::vector<std::size_t> order(square.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return square[a] > square[b]; });
    const double all = std::accumulate(square.begin(), square.end(), 0.0);
    const auto most = static_cast<std::size_t>(few * static_cast<double>(order.size()));
    double found = 0.0;
    std::size_t count = 0;
    while (count < most && found < (1.0 - little) * all)
        found += square[order[count++]];
    if (found < nearly_all * all) return {};
    order.resize(count);
    std::sort(order.begin(), order.end());
    return with_neighbours(order, square.size());
}

/// Where a few blocks hold up all others, their latent states stay until the rest has converged. @return whether some
/// do
bool Minimisation::hold_few() {
    if (released_ || !set_.linked || set_.constraints > 0 || !set_.spread.alone()) return false;
    if (!excess_.hold(few_that_move(), static_cast<std::size_t>(most_held * static_cast<double>(set_.blocks.size()))))
        return false;
    factorise_steps();
    radius_ = std::max(radius_, initial_radius());
    stopping_.begin_again();
    return true;
}

/// Where the rest has converged: whether the full step of all would still move the parameters. Then all blocks move
/// again, to the end.
bool Minimisation::release_held() {
    const std::size_t held = excess_.release();
    if (held == 0) return false;
    factorise_errors();
    set_model();
    factorise_steps();
    released_ = !(model_length_ < converged_sds);
    stopping_.begin_again();
    if (!released_)
        held_message_ = "; the latent states of " + std::to_string(held) + " of " + std::to_string(set_.blocks.size()) +
                        " blocks do not settle and were held: their steps would move the parameters by " +
                        two_figures(model_length_) + " posterior sds";
    return released_;
}

}  // namespace orbid::estimator
