#include "estimator/minimisation/plain_least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <variant>

#include "estimator/algebra/r_factor.hpp"
#include "estimator/minimisation/stacked_rows.hpp"
#include "estimator/minimisation/step_rules.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// The first step is nearly the full one of Gauss-Newton; gains put the damping right within a few steps.
constexpr double first_damping = 1e-4;
/// Damping beyond which a step is below the rounding of every parameter.
constexpr double largest_damping = 1e32;
/// Damping falls to these fractions after a step (Nielsen's third, a fifth where the model was right). A tenth costs
/// half as many derivatives again, because later steps overshoot.
constexpr double slow_fall = 1.0 / 3.0;
constexpr double fast_fall = 0.2;
constexpr double good_gain = 0.9;
/// Probe for the second derivative along a step, as a fraction of it. Its error is this fraction of the third
/// derivative, its rounding 1e-16 divided by the fraction twice.
constexpr double probe = 0.03;
/// With a correction longer than this fraction of the step, two derivatives no longer describe the residuals there
/// (Transtrum and Sethna's bound on 2 |correction| / |step|).
constexpr double longest_correction = 0.75;
/// A path that bent less than this, while the decrease was as predicted, is treated as straight from there on.
constexpr double least_bend = 0.2;
/// After so many trials the damping forgets column norms of earlier places, to this fraction with each step. A start
/// may have columns a million times longer than those near the minimum (MGH10: 1 750 evaluations instead of 4 000).
/// Sooner it loses minima: the largest norms keep steps out of regions where columns vanish.
constexpr int trials_until_forgetting = 200;
constexpr double kept_norm = 0.3;
/// Steps that leave more than this fraction of their length are not worth continuing.
constexpr double least_contraction = 0.9;
/// A parameter is damped at least as if a change by its own size changed the residuals by this fraction of themselves.
constexpr double least_column = 1e-6;

class LeastSquares {
public:
    LeastSquares(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger)
        : problem_(problem),
          set_(set),
          state_(state),
          ledger_(ledger),
          rows_(set),
          parameters_(state.u.size()),
          estimated_(problem.errors.front().estimate),
          slope_(parameters_) {}

    PlainSolution run();

private:
    enum class Verdict { accepted, rejected, stop };

    bool move_by(const Eigen::VectorXd& step, double factor, bool derivatives);
    [[nodiscard]] bool inside(const Eigen::VectorXd& step, double factor) const;
    void factorise();
    void solve_damped();
    bool correct();
    Verdict try_step();
    Verdict polish();
    void start_scale();
    [[nodiscard]] double objective(double square) const;
    void record(double square, bool accepted, double change, StepRejection reason);
    void adopt();
    [[nodiscard]] double square_of_scale() const {
        if (!estimated_) return std::exp(2.0 * state_.psi[0]);
        return square_ / static_cast<double>(std::max<Eigen::Index>(rows_.records() - parameters_, 1));
    }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    SolverStatistics& ledger_;
    StackedRows rows_;
    Eigen::Index parameters_;
    bool estimated_;

    Evaluation now_;
    Eigen::VectorXd e_;      ///< errors divided by their known sds, shape (records)
    double square_ = 0.0;    ///< e^T e
    Eigen::VectorXd slope_;  ///< d theta / d u
    Eigen::MatrixXd triangle_;
    Eigen::VectorXd largest_;  ///< column norms, the largest so far; see kept_norm
    double damping_ = first_damping;
    double raise_ = 2.0;
    double remaining_ = 0.0;  ///< length of the full step, in sds
    double gain_ = 0.0;       ///< actual over predicted decrease of the last trial
    double bend_ = 1.0;       ///< of the last correction, see longest_correction
    double stretch_ = 1.0;
    bool exhausted_ = false;  ///< see PlainSolution

    // Small problems take a microsecond per trial: what has the same size each time keeps its memory.
    Eigen::MatrixXd damped_;  ///< R factor with damping, shape (parameters, parameters + 1)
    Eigen::VectorXd step_;
    Eigen::VectorXd moved_;       ///< R factor times step
    Eigen::VectorXd correction_;  ///< see correct()
    bool derivatives_at_trial_ = true;
    State trial_;
    Evaluation trial_values_;
    Eigen::VectorXd trial_e_;
};

/// Values where a step times a factor leads. @return false where they cannot be computed
bool LeastSquares::move_by(const Eigen::VectorXd& step, double factor, bool derivatives) {
    trial_.u = state_.u + factor * step;
    set_natural_parameters(problem_, trial_.u, trial_.theta);
    trial_values_ = evaluate_trial(problem_.residuals, set_, problem_.laws, trial_.theta, state_.latents, derivatives);
    ++ledger_.evaluations;
    if (!trial_values_.failed.empty()) return false;
    rows_.set_errors(trial_values_, trial_e_);
    return true;
}

/// Whether all coordinates stay inside their bounds.
bool LeastSquares::inside(const Eigen::VectorXd& step, double factor) const {
    for (Eigen::Index i = 0; i < parameters_; ++i) {
        const double u = state_.u[i] + factor * step[i];
        if (!(u >= problem_.lower[i] && u <= problem_.upper[i])) return false;
    }
    return true;
}

void LeastSquares::factorise() {
    for (Eigen::Index i = 0; i < parameters_; ++i)
        slope_[i] = problem_.coordinates[static_cast<std::size_t>(i)].slope(state_.theta[i]);
    triangle_ = rows_.triangle(now_, slope_, e_);
    const auto r = triangle_.topLeftCorner(parameters_, parameters_);
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    Eigen::VectorXd norm = r.colwise().norm().transpose();
    const double least = square_ > 0.0 ? least_column * std::sqrt(square_) : 1.0;
    norm = norm.cwiseMax(least * size.cwiseInverse());
    const double kept = ledger_.trials > trials_until_forgetting ? kept_norm : 1.0;
    if (largest_.size() == 0) largest_ = Eigen::VectorXd::Zero(parameters_);
    largest_ = (kept * largest_).cwiseMax(norm);
    remaining_ = triangle_.col(parameters_).head(parameters_).norm() / std::sqrt(square_of_scale());
}

/// The R factor with damping, and the step.
void LeastSquares::solve_damped() {
    const Eigen::Index q = parameters_;
    damped_ = triangle_.topRows(q);
    add_diagonal(damped_, std::sqrt(damping_) * largest_);
    step_ = -damped_.col(q);
    models::solve_upper_in_place(damped_.leftCols(q), step_);
    moved_.setZero(q);
    for (Eigen::Index j = 0; j < q; ++j)
        moved_.head(j + 1) += step_[j] * triangle_.col(j).head(j + 1);
}

/// Adds the second-order correction to the step: e + J d + 1/2 e'' d^2 is minimised instead of e + J d. Only J^T e'' is
/// needed, and of it J^T J d is known from the R factor.
/// @return false where the correction shows that the step is too long
bool LeastSquares::correct() {
    if (!move_by(step_, probe, false)) return false;
    const Eigen::Index q = parameters_;
    trial_e_ = (trial_e_ - e_) / probe;
    const Eigen::VectorXd risen = rows_.gathered(now_, trial_e_);
    correction_.resize(q);
    for (Eigen::Index j = 0; j < q; ++j) {
        const double straight = triangle_.col(j).head(j + 1).dot(moved_.head(j + 1));
        correction_[j] = (2.0 / probe) * (straight - slope_[j] * risen[j]);
    }
    if (!correction_.allFinite()) return false;
    models::solve_transposed_upper_in_place(damped_.leftCols(q), correction_);
    models::solve_upper_in_place(damped_.leftCols(q), correction_);
    bend_ = 2.0 * largest_.cwiseProduct(correction_).norm() / largest_.cwiseProduct(step_).norm();
    if (!(bend_ <= longest_correction)) return false;
    step_ += 0.5 * correction_;
    return true;
}

/// With the scale at its best, if it is estimated.
double LeastSquares::objective(double square) const {
    const auto n = static_cast<double>(rows_.records());
    const double variance = estimated_ ? square / n : square_of_scale();
    return 0.5 * (n * std::log(2.0 * std::numbers::pi * variance) + square / variance + set_.ln_det_shapes);
}

void LeastSquares::record(double square, bool accepted, double change, StepRejection reason) {
    const double variance = estimated_ ? square / static_cast<double>(rows_.records()) : square_of_scale();
    const double before = objective(square);
    const double after = accepted ? before + 0.5 * std::min(change, 0.0) / variance : before;
    ledger_.history.push_back({ledger_.round, StepBlock::theta, accepted, before, after, damping_, reason});
    if (!accepted) return;
    ++ledger_.iterations;
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, after);
    tell_step({.iteration = ledger_.iterations,
               .round = ledger_.round,
               .objective = after,
               .decrease = before - after,
               .damping = damping_,
               .step = remaining_},
              problem_, trial_.theta);
}

/// Takes the trial.
void LeastSquares::adopt() {
    now_ = std::move(trial_values_);
    std::swap(e_, trial_e_);
    square_ = e_.squaredNorm();
    state_.theta = trial_.theta;
    state_.u = trial_.u;
}

LeastSquares::Verdict LeastSquares::try_step() {
    solve_damped();
    if (!step_.allFinite()) return Verdict::stop;
    const double predicted = -(2.0 * triangle_.col(parameters_).head(parameters_).dot(moved_) + moved_.squaredNorm());
    if (!inside(step_, 1.0)) return Verdict::stop;
    ++ledger_.trials;
    double change = std::numeric_limits<double>::infinity();
    const bool straight = remaining_ < curved_sds || (gain_ > good_gain && bend_ < least_bend);
    const bool corrected = straight || correct();
    if (corrected && !inside(step_, 1.0)) return Verdict::stop;
    if (corrected && move_by(step_, 1.0, derivatives_at_trial_)) {
        change = (trial_e_ - e_).dot(trial_e_ + e_);
        const double gain = gain_ = -change / predicted;
        if (gain > least_plain_gain && (derivatives_at_trial_ || move_by(step_, 1.0, true))) {
            record(square_, true, change, StepRejection::none);
            adopt();
            const double above = 2.0 * gain - 1.0;
            damping_ *= std::max(gain > good_gain ? fast_fall : slow_fall, 1.0 - above * above * above);
            raise_ = 2.0;
            derivatives_at_trial_ = true;
            factorise();
            return Verdict::accepted;
        }
    }
    const bool failed = !trial_values_.failed.empty();
    if (failed && set_.blocks.size() > 1) return Verdict::stop;
    record(square_, false, change, failed ? StepRejection::block_failed : StepRejection::no_decrease);
    // A step that was only too long says nothing against the next one.
    if (corrected || failed) derivatives_at_trial_ = false;
    damping_ *= raise_;
    raise_ *= 2.0;
    const double moved = (step_.cwiseAbs().cwiseQuotient(sizes(problem_, state_.theta))).maxCoeff();
    return damping_ < largest_damping && moved > std::numeric_limits<double>::epsilon() ? Verdict::rejected
                                                                                        : Verdict::stop;
}

/// One full step, kept when it shortens the remaining step. The slopes at both ends give the stretch of the next one.
LeastSquares::Verdict LeastSquares::polish() {
    const Eigen::Index q = parameters_;
    Eigen::VectorXd full = -triangle_.col(q).head(q);
    const double slope = -full.squaredNorm();
    models::solve_upper_in_place(triangle_.topLeftCorner(q, q), full);
    if (!full.allFinite() || !inside(full, stretch_)) return Verdict::stop;
    ++ledger_.trials;
    if (!move_by(full, stretch_, true)) return Verdict::stop;
    const double before = remaining_;
    const double square = square_;
    const State from_state = state_;
    Evaluation from = std::move(now_);
    Eigen::VectorXd from_e = e_;
    const double change = (trial_e_ - e_).dot(trial_e_ + e_);
    adopt();
    factorise();
    damping_ = 0.0;
    exhausted_ = !(remaining_ < least_contraction * before);
    if (!(remaining_ < before)) {
        now_ = std::move(from);
        e_ = std::move(from_e);
        state_ = from_state;
        record(square, false, change, StepRejection::no_decrease);
        return Verdict::stop;
    }
    record(square, true, change, StepRejection::none);
    const double left =
        triangle_.col(q).head(q).dot(triangle_.topLeftCorner(q, q).triangularView<Eigen::Upper>() * full);
    stretch_ = left > slope ? stretch_of_next(stretch_ * slope / (slope - left)) : 1.0;
    return exhausted_ ? Verdict::stop : Verdict::accepted;
}

/// (M10) with independent columns: a start from which the general search has nothing left to do.
void LeastSquares::start_scale() {
    const bool restricted = problem_.options.variance == Variance::restricted;
    const Eigen::Index free = rows_.records() - (restricted ? parameters_ : 0);
    if (!estimated_ || state_.errors_known || free <= 0 || !(square_ > 0.0) || !std::isfinite(square_)) return;
    if (problem_.errors.front().start > 0.0) return;
    state_.psi[0] = 0.5 * std::log(square_ / static_cast<double>(free));
    state_.errors_known = true;
}

PlainSolution LeastSquares::run() {
    trial_.u = state_.u;
    trial_.theta = natural_parameters(problem_, state_.u);
    // Without a first evaluation there is nothing: models::Stopped goes on.
    trial_values_ = evaluate(problem_.residuals, set_, problem_.laws, trial_.theta, state_.latents, true);
    ++ledger_.evaluations;
    if (!trial_values_.failed.empty()) return {std::move(trial_values_)};
    rows_.set_errors(trial_values_, trial_e_);
    if (!std::isfinite(trial_e_.squaredNorm())) return {std::move(trial_values_)};
    adopt();
    factorise();
    tell_step({.iteration = ledger_.iterations, .round = ledger_.round, .objective = objective(square_)}, problem_,
              state_.theta);
    while (remaining_ > polished_sds && std::isfinite(remaining_)) {
        if (ledger_.trials >= problem_.options.maximum_iterations) break;
        if (problem_.options.interrupted && problem_.options.interrupted()) break;
        if ((remaining_ < rounding_sds ? polish() : try_step()) == Verdict::stop) break;
    }
    start_scale();
    return {std::move(now_), exhausted_};
}

}  // namespace

bool is_plain_least_squares(const Problem& problem, const BlockSet& set) {
    if (set.provisional || !set.spread.alone() || problem.laws.size() != 1 ||
        !std::holds_alternative<NormalErrors>(problem.laws.front().distribution) || problem.laws.front().joint())
        return false;
    if (set.latents > 0 || set.constraints > 0 || set.records < static_cast<Eigen::Index>(problem.parameters.size()) ||
        problem.parameters.empty() || !problem.joint_priors.empty())
        return false;
    return std::all_of(set.blocks.begin(), set.blocks.end(),
                       [](const ActiveBlock& block) { return block.cholesky.size() == 0; }) &&
           std::all_of(problem.parameters.begin(), problem.parameters.end(), [](const FreeParameter& parameter) {
               return std::holds_alternative<FlatPrior>(parameter.prior);
           });
}

PlainSolution solve_plain_least_squares(const Problem& problem, const BlockSet& set, State& state,
                                        SolverStatistics& ledger) {
    return LeastSquares(problem, set, state, ledger).run();
}

}  // namespace orbid::estimator
