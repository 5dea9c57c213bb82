#include "estimator/minimisation/plain_least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <variant>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "estimator/algebra/r_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// The first step is nearly the full one of Gauss-Newton; gains put the damping right within a few steps.
constexpr double first_damping = 1e-4;
/// Damping beyond which a step is below the rounding of every parameter.
constexpr double largest_damping = 1e32;
/// Least fraction of the predicted decrease for a step to count.
constexpr double least_gain = 1e-3;
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
constexpr double least_bend = 0.1;
/// Below this length in sds of the parameters corrections do not pay for their evaluation, and decreases are soon
/// hidden by rounding. Plain Gauss-Newton steps follow, judged by the length of the remaining step.
constexpr double plain_within_sds = 1e-3;
constexpr double curved_sds = 0.05;
/// Steps that leave more than this fraction of their length are not worth continuing.
constexpr double least_contraction = 0.9;
/// Rows worked on together (twenty columns of them fit the second cache), and how many make other threads worth waking.
constexpr Eigen::Index piece_records = 1024;
constexpr Eigen::Index parallel_records = 10000;
/// Products of columns are used where each column keeps this fraction of its length beside the others. The R factor
/// then has eight digits, and steps shrink by that much each time; minimise() judges the rest.
constexpr double least_independence = 1e-4;
/// A parameter is damped at least as if a change by its own size changed the residuals by this fraction of themselves.
constexpr double least_column = 1e-6;

class LeastSquares {
public:
    LeastSquares(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger)
        : problem_(problem), set_(set), state_(state), ledger_(ledger), parameters_(state.u.size()) {
        offset_.reserve(set.blocks.size());
        for (std::size_t b = 0; b < set.blocks.size(); ++b) {
            const auto own = static_cast<Eigen::Index>(set.blocks[b].channel.size());
            offset_.push_back(records_);
            records_ += own;
            for (Eigen::Index first = 0; first < own; first += piece_records)
                pieces_.push_back({b, first, std::min(piece_records, own - first)});
        }
        slope_.resize(parameters_);
        estimated_ = problem.errors.front().estimate;
    }

    Evaluation run();

private:
    enum class Verdict { accepted, rejected, stop };

    bool move_to(const Eigen::VectorXd& u, bool derivatives);
    [[nodiscard]] Eigen::VectorXd errors(const Evaluation& evaluation) const;
    /// Rows of a block that stay in the cache while they are worked on.
    struct Piece {
        std::size_t block = 0;
        Eigen::Index first = 0;
        Eigen::Index count = 0;
    };

    template <class Use>
    void with_rows(const Piece& piece, Use use) const;
    [[nodiscard]] Eigen::VectorXd moved_errors(const Eigen::VectorXd& step) const;
    [[nodiscard]] Eigen::VectorXd gathered(const Eigen::VectorXd& along) const;
    bool by_products();
    void factorise();
    void solve_damped();
    bool correct();
    Verdict try_step();
    Verdict polish();
    void start_scale();
    void record(double square, bool accepted, double change, std::string_view reason);
    void adopt(Evaluation&& evaluation, Eigen::VectorXd&& e);
    [[nodiscard]] double square_of_scale() const {
        if (!estimated_) return std::exp(2.0 * state_.psi[0]);
        return square_ / static_cast<double>(std::max<Eigen::Index>(records_ - parameters_, 1));
    }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    SolverStatistics& ledger_;
    Eigen::Index parameters_;
    Eigen::Index records_ = 0;
    std::vector<Eigen::Index> offset_;  ///< first record of each block
    bool estimated_ = true;

    Evaluation now_;
    Eigen::VectorXd e_;      ///< errors divided by their known sds, shape (records)
    double square_ = 0.0;    ///< e^T e
    Eigen::VectorXd slope_;  ///< d theta / d u
    std::vector<Piece> pieces_;
    Eigen::MatrixXd triangle_;
    Eigen::VectorXd largest_;  ///< column norms, the largest so far
    double damping_ = first_damping;
    double raise_ = 2.0;
    double remaining_ = 0.0;  ///< length of the full step, in sds
    double gain_ = 0.0;       ///< actual over predicted decrease of the last trial
    double bend_ = 1.0;       ///< of the last correction, see longest_correction
    double stretch_ = 1.0;

    Eigen::MatrixXd damped_;  ///< R factor with damping, shape (parameters, parameters + 1)
    Eigen::VectorXd step_;
    Eigen::VectorXd moved_;  ///< R factor times step
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

/// Rows [first, first + count) of a block's derivatives, divided by the known sds.
template <class Use>
void LeastSquares::with_rows(const Piece& piece, Use use) const {
    const auto rows = now_.values[piece.block].e_theta.middleRows(piece.first, piece.count);
    const Eigen::VectorXd& deviation = set_.blocks[piece.block].deviation;
    if (deviation.size() == 0)
        use(rows);
    else
        use(deviation.segment(piece.first, piece.count).cwiseInverse().asDiagonal() * rows);
}

/// The R factor by products of columns, at a fraction of the cost of reflections, where the columns are far enough from
/// dependence. Its relative error is the rounding divided by the square of the least diagonal.
/// @return whether they are
bool LeastSquares::by_products() {
    const Eigen::Index q = parameters_;
    // Columns ... q - 1 of the upper triangle: E^T E; column q: E^T e. Summed in the order of the pieces, whatever the
    // number of threads.
    Eigen::MatrixXd products = Eigen::MatrixXd::Zero(q, q + 1);
    const auto add = [&](const Piece& piece, Eigen::MatrixXd& sum) {
        with_rows(piece, [&](const auto& rows) {
            const Eigen::Ref<const Eigen::MatrixXd> own(rows);
            sum.leftCols(q).selfadjointView<Eigen::Upper>().rankUpdate(own.transpose());
            sum.col(q).noalias() += own.transpose() * e_.segment(offset_[piece.block] + piece.first, piece.count);
        });
    };
    if (records_ < parallel_records) {
        for (const Piece& piece : pieces_)
            add(piece, products);
    } else {
        std::vector<Eigen::MatrixXd> sums(pieces_.size(), products);
        oneapi::tbb::parallel_for(std::size_t{0}, pieces_.size(), [&](std::size_t p) { add(pieces_[p], sums[p]); });
        for (const Eigen::MatrixXd& sum : sums)
            products += sum;
    }
    const Eigen::VectorXd norm = products.diagonal().cwiseSqrt();
    if (!(norm.minCoeff() > 0.0) || !norm.allFinite()) return false;
    triangle_ = Eigen::MatrixXd::Zero(q + 1, q + 1);
    for (Eigen::Index j = 0; j < q; ++j)
        for (Eigen::Index i = 0; i <= j; ++i) {
            const double rest =
                products(i, j) / (norm[i] * norm[j]) - triangle_.col(i).head(i).dot(triangle_.col(j).head(i));
            if (i == j && !(rest > least_independence * least_independence)) return false;
            triangle_(i, j) = i == j ? std::sqrt(rest) : rest / triangle_(i, i);
        }
    Eigen::VectorXd rhs = products.col(q).cwiseQuotient(norm);
    models::solve_transposed_upper_in_place(triangle_.topLeftCorner(q, q), rhs);
    triangle_.topLeftCorner(q, q) *= norm.cwiseProduct(slope_).asDiagonal();
    triangle_.col(q).head(q) = rhs;
    return true;
}

/// de/du times a step, and its transpose times one number per record.
Eigen::VectorXd LeastSquares::moved_errors(const Eigen::VectorXd& step) const {
    Eigen::VectorXd result(records_);
    const Eigen::VectorXd natural = slope_.cwiseProduct(step);
    for (const Piece& piece : pieces_)
        with_rows(piece, [&](const auto& rows) {
            result.segment(offset_[piece.block] + piece.first, piece.count).noalias() = rows * natural;
        });
    return result;
}

Eigen::VectorXd LeastSquares::gathered(const Eigen::VectorXd& along) const {
    Eigen::VectorXd result = Eigen::VectorXd::Zero(parameters_);
    for (const Piece& piece : pieces_)
        with_rows(piece, [&](const auto& rows) {
            result.noalias() += rows.transpose() * along.segment(offset_[piece.block] + piece.first, piece.count);
        });
    return slope_.cwiseProduct(result);
}

void LeastSquares::factorise() {
    for (Eigen::Index i = 0; i < parameters_; ++i)
        slope_[i] = problem_.coordinates[static_cast<std::size_t>(i)].slope(state_.theta[i]);
    if (!by_products()) {
        Eigen::MatrixXd rows(records_, parameters_ + 1);
        for (const Piece& piece : pieces_)
            with_rows(piece, [&](const auto& own) {
                rows.block(offset_[piece.block] + piece.first, 0, piece.count, parameters_) = own * slope_.asDiagonal();
            });
        rows.col(parameters_) = e_;
        triangle_ = upper_triangle(rows);
    }
    const auto r = triangle_.topLeftCorner(parameters_, parameters_);
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    Eigen::VectorXd norm = r.colwise().norm().transpose();
    const double least = square_ > 0.0 ? least_column * std::sqrt(square_) : 1.0;
    norm = norm.cwiseMax(least * size.cwiseInverse());
    largest_ = largest_.size() == 0 ? norm : Eigen::VectorXd(largest_.cwiseMax(norm));
    remaining_ = triangle_.col(parameters_).head(parameters_).norm() / std::sqrt(square_of_scale());
}

/// The R factor of [r | rhs] on top of sqrt(damping) times the column norms, by rotations, and the step.
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
    models::solve_upper_in_place(damped_.leftCols(q), step_);
    moved_ = triangle_.topLeftCorner(q, q).triangularView<Eigen::Upper>() * step_;
}

/// Adds the second-order correction to the step: e + J d + 1/2 e'' d^2 is minimised instead of e + J d.
/// @return false where the correction shows that the step is too long
bool LeastSquares::correct() {
    if (!move_to(state_.u + probe * step_, false)) return false;
    const Eigen::VectorXd at_probe = errors(trial_values_);
    const Eigen::VectorXd second = (2.0 / probe) * ((at_probe - e_) / probe - moved_errors(step_));
    if (!second.allFinite()) return false;
    Eigen::VectorXd correction = -gathered(second);
    models::solve_transposed_upper_in_place(damped_.leftCols(parameters_), correction);
    models::solve_upper_in_place(damped_.leftCols(parameters_), correction);
    bend_ = 2.0 * largest_.cwiseProduct(correction).norm() / largest_.cwiseProduct(step_).norm();
    if (!(bend_ <= longest_correction)) return false;
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
    const bool straight = remaining_ < curved_sds || (gain_ > good_gain && bend_ < least_bend);
    const bool corrected = straight || correct();
    if (corrected && !inside(problem_, state_.u + step_)) return Verdict::stop;
    if (corrected && move_to(state_.u + step_, derivatives_at_trial_)) {
        Eigen::VectorXd e = errors(trial_values_);
        change = (e - e_).dot(e + e_);
        const double gain = gain_ = -change / predicted;
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

/// One full step, kept when it shortens the remaining step. Near the minimum these steps keep their direction and are
/// too long or too short by the same factor each time. The slopes at both ends of the last one give that factor.
LeastSquares::Verdict LeastSquares::polish() {
    const Eigen::Index q = parameters_;
    Eigen::VectorXd full = -triangle_.col(q).head(q);
    const double slope = -full.squaredNorm();
    models::solve_upper_in_place(triangle_.topLeftCorner(q, q), full);
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

/// (M10) with independent columns: a start from which the general search has nothing left to do.
void LeastSquares::start_scale() {
    const bool restricted = problem_.options.variance == Variance::restricted;
    const Eigen::Index free = records_ - (restricted ? parameters_ : 0);
    if (!estimated_ || state_.errors_known || free <= 0 || !(square_ > 0.0) || !std::isfinite(square_)) return;
    if (problem_.errors.front().start > 0.0) return;
    state_.psi[0] = 0.5 * std::log(square_ / static_cast<double>(free));
    state_.errors_known = true;
}

Evaluation LeastSquares::run() {
    if (!move_to(state_.u, true)) return std::move(trial_values_);
    Eigen::VectorXd e = errors(trial_values_);
    if (!std::isfinite(e.squaredNorm())) return std::move(trial_values_);
    adopt(std::move(trial_values_), std::move(e));
    factorise();
    while (remaining_ > polished_sds && std::isfinite(remaining_)) {
        if (ledger_.trials >= problem_.options.maximum_iterations) break;
        if (problem_.options.interrupted && problem_.options.interrupted()) break;
        if ((remaining_ < plain_within_sds ? polish() : try_step()) == Verdict::stop) break;
    }
    start_scale();
    return std::move(now_);
}

}  // namespace

bool is_plain_least_squares(const Problem& problem, const BlockSet& set) {
    if (set.provisional || problem.laws.size() != 1 ||
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

Evaluation solve_plain_least_squares(const Problem& problem, const BlockSet& set, State& state,
                                     SolverStatistics& ledger) {
    return LeastSquares(problem, set, state, ledger).run();
}

}  // namespace orbid::estimator
