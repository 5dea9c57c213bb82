#include "estimator/plain_least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <variant>

#include "estimator/triangle.hpp"

namespace orbid::estimator {

namespace {

/// The first step is nearly the full one of Gauss-Newton; gains put the damping right within a few steps.
constexpr double first_damping = 1e-4;
/// Damping beyond which a step is below the rounding of every parameter.
constexpr double largest_damping = 1e32;
/// Least share of the promised decrease for a step to count.
constexpr double least_gain = 1e-3;
/// Damping falls to these shares after a step (Nielsen's third, a fifth where the model was right): a tenth costs half
/// as many derivatives again, because later steps overshoot.
constexpr double slow_fall = 1.0 / 3.0;
constexpr double fast_fall = 0.2;
constexpr double good_gain = 0.9;
/// Probe for the second derivative along a step, as a share of it: its error is this share of the third derivative, its
/// rounding 1e-16 divided by the share twice.
constexpr double probe = 0.03;
/// A correction longer than this share of the step says that the step leaves the region where two derivatives describe
/// the residuals (Transtrum and Sethna's bound on 2 |correction| / |step|).
constexpr double longest_correction = 0.75;
/// Below this length in sds of the parameters corrections are not worth their evaluation, and decreases drown in
/// rounding soon: plain Gauss-Newton steps, judged by the length of the step that is left.
constexpr double near_sds = 1e-3;
constexpr double curved_sds = 0.05;
/// See minimise(): nothing that is ever shown changes below it.
constexpr double polished = 1e-10;
/// Steps that leave more than this share of their length are not worth going on with.
constexpr double least_contraction = 0.9;
/// Columns below this share of the largest (per size of the parameter) are damped as if they had it.
constexpr double least_column = 1e-6;

class LeastSquares {
public:
    LeastSquares(const Problem& problem, const BlockSet& set, State& state, Ledger& ledger)
        : problem_(problem), set_(set), state_(state), ledger_(ledger), parameters_(state.u.size()) {
        offset_.reserve(set.blocks.size());
        for (const ActiveBlock& block : set.blocks) {
            offset_.push_back(records_);
            records_ += static_cast<Eigen::Index>(block.channel.size());
        }
        estimated_ = problem.errors.front().estimate;
    }

    Evaluation run();

private:
    enum class Verdict { accepted, rejected, stop };

    bool move_to(const Eigen::VectorXd& u, bool derivatives);
    [[nodiscard]] Eigen::VectorXd errors(const Evaluation& evaluation) const;
    void factorise();
    void solve_damped();
    bool correct();
    Verdict try_step();
    Verdict polish();
    void record(double square, bool accepted, double change, std::string_view reason);
    void adopt(Evaluation&& evaluation, Eigen::VectorXd&& e);
    [[nodiscard]] double square_of_scale() const {
        if (!estimated_) return std::exp(2.0 * state_.psi[0]);
        return square_ / static_cast<double>(std::max<Eigen::Index>(records_ - parameters_, 1));
    }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    Ledger& ledger_;
    Eigen::Index parameters_;
    Eigen::Index records_ = 0;
    std::vector<Eigen::Index> offset_;  ///< first record of each block
    bool estimated_ = true;

    Evaluation now_;
    Eigen::VectorXd e_;     ///< errors divided by their known sds, shape (records)
    double square_ = 0.0;   ///< e^T e
    Eigen::MatrixXd rows_;  ///< [de/du | e], shape (records, parameters + 1)
    Eigen::MatrixXd triangle_;
    Eigen::VectorXd largest_;  ///< column norms, the largest so far
    double damping_ = first_damping;
    double raise_ = 2.0;
    double remaining_ = 0.0;  ///< length of the full step, in sds
    double stretch_ = 1.0;

    Eigen::MatrixXd damped_;  ///< triangle with damping, shape (parameters, parameters + 1)
    Eigen::VectorXd step_;
    Eigen::VectorXd moved_;  ///< triangle times step
    bool derivatives_at_trial_ = true;
    State trial_;
    Evaluation trial_values_;
};

/// Values at coordinates u. @return false where they cannot be computed
bool LeastSquares::move_to(const Eigen::VectorXd& u, bool derivatives) {
    trial_.u = u;
    trial_.theta.resize(parameters_);
    for (Eigen::Index i = 0; i < parameters_; ++i) {
        const auto index = static_cast<std::size_t>(i);
        trial_.theta[i] = std::clamp(problem_.coordinates[index].natural(u[i]), problem_.parameters[index].lower,
                                     problem_.parameters[index].upper);
    }
    trial_values_ = evaluate(problem_.residuals, set_, problem_.laws, trial_.theta, state_.latents, derivatives);
    ++ledger_.evaluations;
    return trial_values_.failed.empty();
}

Eigen::VectorXd LeastSquares::errors(const Evaluation& evaluation) const {
    Eigen::VectorXd e(records_);
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        const Eigen::VectorXd& deviation = set_.blocks[b].deviation;
        const Eigen::VectorXd& own = evaluation.values[b].e;
        if (deviation.size() > 0)
            e.segment(offset_[b], own.size()) = own.cwiseQuotient(deviation);
        else
            e.segment(offset_[b], own.size()) = own;
    }
    return e;
}

void LeastSquares::factorise() {
    rows_.resize(records_, parameters_ + 1);
    Eigen::VectorXd slope(parameters_);
    for (Eigen::Index i = 0; i < parameters_; ++i)
        slope[i] = problem_.coordinates[static_cast<std::size_t>(i)].slope(state_.theta[i]);
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        const Eigen::MatrixXd& own = now_.values[b].e_theta;
        auto target = rows_.block(offset_[b], 0, own.rows(), parameters_);
        target = own * slope.asDiagonal();
        if (set_.blocks[b].deviation.size() > 0) target.array().colwise() /= set_.blocks[b].deviation.array();
    }
    rows_.col(parameters_) = e_;
    triangle_ = upper_triangle(rows_);
    const auto r = triangle_.topLeftCorner(parameters_, parameters_);
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    Eigen::VectorXd norm = r.colwise().norm().transpose();
    const double most = norm.cwiseProduct(size).maxCoeff();
    norm = norm.cwiseMax(least_column * (most > 0.0 ? most : 1.0) * size.cwiseInverse());
    largest_ = largest_.size() == 0 ? norm : Eigen::VectorXd(largest_.cwiseMax(norm));
    remaining_ = triangle_.col(parameters_).head(parameters_).norm() / std::sqrt(square_of_scale());
}

/// The triangle of [r | rhs] on top of sqrt(damping) times the column norms, by rotations, and the step.
void LeastSquares::solve_damped() {
    const Eigen::Index q = parameters_;
    damped_ = triangle_.topRows(q);
    Eigen::RowVectorXd row(q + 1);
    const double root = std::sqrt(damping_);
    for (Eigen::Index i = 0; i < q; ++i) {
        row.setZero();
        row[i] = root * largest_[i];
        for (Eigen::Index k = i; k < q; ++k) {
            const double length = std::hypot(damped_(k, k), row[k]);
            if (!(length > 0.0)) continue;
            const double c = damped_(k, k) / length;
            const double s = row[k] / length;
            for (Eigen::Index j = k; j <= q; ++j) {
                const double above = damped_(k, j);
                damped_(k, j) = c * above + s * row[j];
                row[j] = c * row[j] - s * above;
            }
        }
    }
    step_ = -damped_.col(q);
    damped_.leftCols(q).triangularView<Eigen::Upper>().solveInPlace(step_);
    moved_ = triangle_.topLeftCorner(q, q).triangularView<Eigen::Upper>() * step_;
}

/// Adds the second-order correction to the step: e + J d + 1/2 e'' d^2 is minimised instead of e + J d.
/// @return false where the correction says that the step is too long
bool LeastSquares::correct() {
    if (!move_to(state_.u + probe * step_, false)) return false;
    const Eigen::VectorXd at_probe = errors(trial_values_);
    const Eigen::VectorXd second = (2.0 / probe) * ((at_probe - e_) / probe - rows_.leftCols(parameters_) * step_);
    if (!second.allFinite()) return false;
    Eigen::VectorXd correction = -(rows_.leftCols(parameters_).transpose() * second);
    const auto r = damped_.leftCols(parameters_).triangularView<Eigen::Upper>();
    damped_.leftCols(parameters_).transpose().triangularView<Eigen::Lower>().solveInPlace(correction);
    r.solveInPlace(correction);
    const double share = 2.0 * largest_.cwiseProduct(correction).norm() / largest_.cwiseProduct(step_).norm();
    if (!(share <= longest_correction)) return false;
    step_ += 0.5 * correction;
    return true;
}

void LeastSquares::record(double square, bool accepted, double change, std::string_view reason) {
    const auto n = static_cast<double>(records_);
    const double variance = estimated_ ? square / n : square_of_scale();
    const double before =
        0.5 * (n * std::log(2.0 * std::numbers::pi * variance) + square / variance + set_.ln_det_shapes);
    const double after = accepted ? before + 0.5 * std::min(change, 0.0) / variance : before;
    ledger_.history.push_back({ledger_.round, "theta", accepted, before, after, damping_, reason});
    if (!accepted) return;
    ++ledger_.iterations;
    if (problem_.options.progress) problem_.options.progress(ledger_.iterations, after);
}

void LeastSquares::adopt(Evaluation&& evaluation, Eigen::VectorXd&& e) {
    now_ = std::move(evaluation);
    e_ = std::move(e);
    square_ = e_.squaredNorm();
    state_.theta = trial_.theta;
    state_.u = trial_.u;
}

/// Whether all coordinates stay inside their bounds.
bool inside(const Problem& problem, const Eigen::VectorXd& u) {
    return (u.array() >= problem.lower.array()).all() && (u.array() <= problem.upper.array()).all();
}

LeastSquares::Verdict LeastSquares::try_step() {
    solve_damped();
    if (!step_.allFinite()) return Verdict::stop;
    const double predicted = -(2.0 * triangle_.col(parameters_).head(parameters_).dot(moved_) + moved_.squaredNorm());
    if (!inside(problem_, state_.u + step_)) return Verdict::stop;
    ++ledger_.trials;
    double change = std::numeric_limits<double>::infinity();
    std::string_view reason = "no decrease";
    const bool corrected = remaining_ < curved_sds || correct();
    if (corrected && !inside(problem_, state_.u + step_)) return Verdict::stop;
    if (corrected && move_to(state_.u + step_, derivatives_at_trial_)) {
        Eigen::VectorXd e = errors(trial_values_);
        change = (e - e_).dot(e + e_);
        const double gain = -change / predicted;
        if (gain > least_gain && (derivatives_at_trial_ || move_to(trial_.u, true))) {
            record(square_, true, change, "");
            adopt(std::move(trial_values_), std::move(e));
            damping_ *= std::max(gain > good_gain ? fast_fall : slow_fall, 1.0 - std::pow(2.0 * gain - 1.0, 3));
            raise_ = 2.0;
            derivatives_at_trial_ = true;
            factorise();
            return Verdict::accepted;
        }
    }
    if (!trial_values_.failed.empty()) {
        reason = "block failed";
        if (set_.blocks.size() > 1) return Verdict::stop;
    }
    record(square_, false, change, reason);
    derivatives_at_trial_ = false;
    damping_ *= raise_;
    raise_ *= 2.0;
    const double moved = (step_.cwiseAbs().cwiseQuotient(sizes(problem_, state_.theta))).maxCoeff();
    return damping_ < largest_damping && moved > std::numeric_limits<double>::epsilon() ? Verdict::rejected
                                                                                        : Verdict::stop;
}

/// One full step, kept when it shortens the step that is left. Close to the minimum these steps keep their direction
/// and are too long or too short by the same factor each time, which the slopes at both ends of the last one tell.
LeastSquares::Verdict LeastSquares::polish() {
    const Eigen::Index q = parameters_;
    Eigen::VectorXd full = -triangle_.col(q).head(q);
    const double slope = -full.squaredNorm();
    triangle_.topLeftCorner(q, q).triangularView<Eigen::Upper>().solveInPlace(full);
    const Eigen::VectorXd u = state_.u + stretch_ * full;
    if (!full.allFinite() || !inside(problem_, u)) return Verdict::stop;
    ++ledger_.trials;
    if (!move_to(u, true)) return Verdict::stop;
    const double before = remaining_;
    const double square = square_;
    const Eigen::VectorXd from_theta = state_.theta;
    const Eigen::VectorXd from_u = state_.u;
    Evaluation from = std::move(now_);
    Eigen::VectorXd from_e = e_;
    Eigen::VectorXd e = errors(trial_values_);
    const double change = (e - e_).dot(e + e_);
    adopt(std::move(trial_values_), std::move(e));
    factorise();
    damping_ = 0.0;
    if (!(remaining_ < before)) {
        now_ = std::move(from);
        e_ = std::move(from_e);
        state_.theta = from_theta;
        state_.u = from_u;
        record(square, false, change, "no decrease");
        return Verdict::stop;
    }
    record(square, true, change, "");
    const double left =
        triangle_.col(q).head(q).dot(triangle_.topLeftCorner(q, q).triangularView<Eigen::Upper>() * full);
    stretch_ = left > slope ? std::clamp(stretch_ * slope / (slope - left), 0.4, 2.5) : 1.0;
    return remaining_ < least_contraction * before ? Verdict::accepted : Verdict::stop;
}

Evaluation LeastSquares::run() {
    if (!move_to(state_.u, true)) return std::move(trial_values_);
    Eigen::VectorXd e = errors(trial_values_);
    if (!std::isfinite(e.squaredNorm())) return std::move(trial_values_);
    adopt(std::move(trial_values_), std::move(e));
    factorise();
    while (remaining_ > polished && std::isfinite(remaining_)) {
        if (ledger_.trials >= problem_.options.maximum_iterations) break;
        if (problem_.options.interrupted && problem_.options.interrupted()) break;
        if ((remaining_ < near_sds ? polish() : try_step()) == Verdict::stop) break;
    }
    return std::move(now_);
}

}  // namespace

bool is_plain_least_squares(const Problem& problem, const BlockSet& set) {
    if (problem.laws.size() != 1 || !std::holds_alternative<NormalErrors>(problem.laws.front().distribution) ||
        problem.laws.front().joint())
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

Evaluation solve_plain_least_squares(const Problem& problem, const BlockSet& set, State& state, Ledger& ledger) {
    return LeastSquares(problem, set, state, ledger).run();
}

}  // namespace orbid::estimator
