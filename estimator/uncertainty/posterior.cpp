#include "estimator/uncertainty/posterior.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/uncertainty/error_interval.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// 97.5 % quantile of Student's t; of the normal where the degrees of freedom no longer matter.
double quantile_975(double degrees) {
    // Without promotion to long double, which costs three times as much for digits that no interval has.
    using Policy = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
    if (!(degrees < 1e9)) return boost::math::quantile(boost::math::normal_distribution<double, Policy>(), 0.975);
    return boost::math::quantile(boost::math::students_t_distribution<double, Policy>(std::max(degrees, 1.0)), 0.975);
}

}  // namespace

Posterior::Posterior(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum)
    : problem_(problem), set_(set), state_(state), minimum_(minimum) {
    const Eigen::Index q = state.u.size();
    const BoundedStep& step = minimum.step;
    errors_ = error_problem(problem, set, minimum, Follow::latents);
    point_ = evaluate_errors(errors_, state.psi);

    Eigen::MatrixXd half = step.decided.transpose();
    models::solve_transposed_upper_in_place(point_.triangle, half);
    laplace_ = half.transpose() * half;
    covariance_ = laplace_;

    const Eigen::VectorXd size = sizes(problem, state.theta);
    Eigen::VectorXd column_size = size;
    for (Eigen::Index i = 0; i < q; ++i) {
        const auto index = static_cast<std::size_t>(i);
        const Prior& prior = problem.parameters[index].prior;
        if (is_proper(prior)) column_size[i] = problem.coordinates[index].prior_sd(prior, state.theta[i]);
    }
    identifiability_ = identifiability(reduced_problem().r, step, size, column_size);

    const Eigen::Index dead = undetermined_states(arrow());
    degrees_of_freedom_ =
        static_cast<double>(set.records - (set.latents - dead - set.constraints) - step.space.data.cols());
    error_parameters();
    leave_out_slack();
    look_for_autocorrelation();
    make_sandwich();

    // Latent states with what the uncertainty of theta adds.
    latent_sds_.resize(set.blocks.size());
    const auto take = [&](std::size_t b, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
        const Eigen::Index l = set_.blocks[b].latents;
        latent_sds_[b] = covariance.diagonal().head(l).cwiseSqrt();
        for (Eigen::Index j = 0; j < l; ++j)
            if (arrow().blocks[b].dead[static_cast<std::size_t>(j)]) latent_sds_[b][j] = nan_value;
    };
    visit_covariance(arrow(), reduced_problem(), covariance_, take, {});
}

/// Laplace covariance of the error parameters: the inverse Hessian of Phi_psi with theta and z at their minimum.
void Posterior::error_parameters() {
    const auto count_all = static_cast<Eigen::Index>(problem_.errors.size());
    error_covariance_ = Eigen::MatrixXd::Zero(count_all, count_all);
    for (Eigen::Index k = 0; k < count_all; ++k) {
        const auto index = static_cast<std::size_t>(k);
        if (errors_.free[index] && !minimum_.error_at_floor[index] && !minimum_.error_at_ceiling[index])
            free_errors_.push_back(k);
    }
    const std::size_t present = static_cast<std::size_t>((set_.count.array() > 0.0).count());
    one_scale_ = present == 1 && free_errors_.size() == 1 &&
                 std::any_of(problem_.laws.begin(), problem_.laws.end(), [this](const NoiseModel& law) {
                     return law.first == free_errors_.front() && law.compressible();
                 });
    if (!problem_.options.error_uncertainties) {
        error_covariance_(free_errors_, free_errors_).setConstant(nan_value);
        free_errors_.clear();
    }
    if (free_errors_.empty()) return;
    if (one_scale_) {
        // Only the restricted scale is the root of the sum of squares over the degrees of freedom; the others also
        // divide by those of the parameters. The interval is still that of the t statistic.
        const double taken = problem_.options.variance == Variance::restricted
                                 ? 0.0
                                 : static_cast<double>(minimum_.step.space.data.cols());
        t_quantile_ = quantile_975(degrees_of_freedom_) * std::sqrt(1.0 + taken / degrees_of_freedom_);
    }
    ErrorProblem profiled = errors_;
    profiled.follow = Follow::all;
    Eigen::MatrixXd hessian = error_hessian(profiled, point_, state_.psi, free_errors_);
    // A logarithm whose sd would be thirty: the objective is flat there, nothing else depends on it, and neither its
    // curvature nor its sd is meaningful.
    constexpr double least_curvature = 1e-3;
    std::vector<Eigen::Index> kept;
    for (Eigen::Index i = 0; i < hessian.rows(); ++i) {
        const Eigen::Index k = free_errors_[static_cast<std::size_t>(i)];
        const bool logarithmic = problem_.errors[static_cast<std::size_t>(k)].kind == ErrorCoordinate::Kind::log;
        if (logarithmic && !(hessian(i, i) > least_curvature))
            negligible_errors_.push_back(k);
        else
            kept.push_back(i);
    }
    if (!negligible_errors_.empty()) {
        hessian = hessian(kept, kept).eval();
        for (Eigen::Index& i : kept)
            i = free_errors_[static_cast<std::size_t>(i)];
        free_errors_ = kept;
        if (free_errors_.empty()) return;
    }
    const auto count = hessian.rows();
    const models::LdltFactor factor(hessian);
    const auto pivots = factor.pivots();
    const bool definite = factor.succeeded() && factor.positive_semidefinite() && pivots.minCoeff() > 0.0;
    const Eigen::MatrixXd inverse = definite ? factor.inverse() : Eigen::MatrixXd::Constant(count, count, nan_value);
    ln_error_determinant_ = definite ? pivots.array().log().sum() : nan_value;
    error_covariance_(free_errors_, free_errors_) = inverse;
    add_error_uncertainty();
}

std::pair<double, double> Posterior::error_interval(Eigen::Index k) const {
    const double sd = std::sqrt(error_covariance_(k, k));
    if (!(sd > 0.0) || !std::isfinite(sd)) return {nan_value, nan_value};
    const auto count = static_cast<Eigen::Index>(problem_.errors.size());
    Eigen::VectorXd floor(count);
    Eigen::VectorXd ceiling(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        floor[i] = problem_.errors[static_cast<std::size_t>(i)].lower;
        ceiling[i] = problem_.errors[static_cast<std::size_t>(i)].upper;
    }
    ErrorProblem followed = errors_;
    followed.follow = Follow::all;
    return estimator::error_interval(std::move(followed), state_.psi, k, sd, floor, ceiling);
}

/// Where theta and psi inform each other in expectation (relative errors), or where the posterior of psi is requested
/// (integrated): Cov(theta) = E Cov(theta | psi) + Cov E(theta | psi), with the slope of the conditional mode, d y / d
/// psi = -H^-1 d(S^T s) / d psi.
void Posterior::add_error_uncertainty() {
    const bool integrated = problem_.options.variance == Variance::integrated;
    const Eigen::Index rank = point_.triangle.rows();
    moved_by_errors_ = Eigen::MatrixXd::Zero(rank, static_cast<Eigen::Index>(free_errors_.size()));
    if (rank == 0) return;
    bool any = false;
    for (std::size_t i = 0; i < free_errors_.size(); ++i) {
        const Eigen::Index k = free_errors_[i];
        const auto law = std::find_if(problem_.laws.begin(), problem_.laws.end(),
                                      [k](const NoiseModel& candidate) { return candidate.has(k); });
        if (!integrated && !std::holds_alternative<RelativeErrors>(law->distribution)) continue;
        any = true;
        // Gradient of the reduced problem with respect to y, by its change with psi: central differences of S_y^T s -
        // (latent part), with the latent states following.
        constexpr double h = 1e-5;
        Eigen::VectorXd difference = Eigen::VectorXd::Zero(rank);
        for (const double sign : {-1.0, 1.0}) {
            Eigen::VectorXd shifted = state_.psi;
            shifted[k] += sign * h;
            const ReducedProblem reduced_problem = condense(
                standard_arrow(set_, minimum_.rows, problem_.laws, shifted, minimum_.matching, Curvature::expected)
                    .arrow,
                0.0);
            difference +=
                sign / (2.0 * h) * (errors_.basis.transpose() * (reduced_problem.r.transpose() * reduced_problem.rhs));
        }
        models::solve_transposed_upper_in_place(point_.triangle, difference);
        models::solve_upper_in_place(point_.triangle, difference);
        moved_by_errors_.col(static_cast<Eigen::Index>(i)) = -difference;
    }
    if (!any) return;
    const Eigen::MatrixXd errors = error_covariance_(free_errors_, free_errors_);
    const Eigen::MatrixXd through = minimum_.step.decided * moved_by_errors_;
    laplace_ += through * errors * through.transpose();
    covariance_ = laplace_;
}

double Posterior::objective() const {
    // (M8) leaves out the constants of the normal density.
    double value = point_.value + 0.5 * set_.ln_det_shapes + minimum_.prior.value -
                   0.5 * std::log(2.0 * std::numbers::pi) * static_cast<double>(set_.records);
    // The factor is computed in equilibrated coordinates; their units convert it to u.
    if (problem_.options.variance == Variance::restricted) value += minimum_.step.space.unit.array().log().sum();
    return value + constraint_term();
}

/// Constraints as errors of size q have the density exp(-(c / q)^2 / 2) / (q sqrt(2 pi)); the limit q -> 0 is finite.
double Posterior::constraint_term() const {
    double value = 0.0;
    for (const ActiveBlock& block : set_.blocks)
        if (block.constraints > 0)
            value += block.constraint_size.array().log().sum() +
                     static_cast<double>(block.constraints) * std::log(minimum_.matching);
    return set_.spread.sum(value);
}

double Posterior::log_likelihood() const {
    return -point_.standard.value - 0.5 * set_.ln_det_shapes;
}

double Posterior::log_integral() const {
    const double ln_two_pi = std::log(2.0 * std::numbers::pi);
    double value = -point_.value - 0.5 * set_.ln_det_shapes - minimum_.prior.value - constraint_term();
    // -Phi_psi holds -1/2 ln|H| over the latent states, and with "restricted" over the parameters.
    if (problem_.options.variance != Variance::restricted)
        value -= point_.triangle.diagonal().array().abs().log().sum();
    value -= minimum_.step.space.unit.array().log().sum();
    value -= 0.5 * ln_error_determinant_;
    const double integrated = static_cast<double>(point_.triangle.rows() + set_.latents - set_.constraints) +
                              static_cast<double>(free_errors_.size());
    return value + 0.5 * ln_two_pi * integrated;
}

/// d ln of (y^T C y) / d psi over the free error parameters, times y^T C y: -2 v^T S^T dS v, v = H^-1 (0, y).
Eigen::VectorXd Posterior::variance_slopes(const Eigen::VectorXd& y) const {
    Eigen::VectorXd v = y;
    models::solve_transposed_upper_in_place(point_.triangle, v);
    models::solve_upper_in_place(point_.triangle, v);
    v = errors_.basis * v;
    // Latent states that follow v, without what their own residuals ask for.
    const std::vector<Eigen::VectorXd> still =
        latent_steps(point_.standard.arrow, point_.reduced_problem, Eigen::VectorXd::Zero(v.size()));
    const std::vector<Eigen::VectorXd> moved = latent_steps(point_.standard.arrow, point_.reduced_problem, v);
    Eigen::VectorXd slopes = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(free_errors_.size()));
    const auto add = [&](const BlockRows& block, const std::vector<PartRows>& parts,
                         const Eigen::Ref<const Eigen::MatrixXd>& at, const Eigen::VectorXd& step,
                         Eigen::VectorXd& sums) {
        const Eigen::VectorXd here = at.leftCols(step.size()).lazyProduct(step);
        for (std::size_t i = 0; i < free_errors_.size(); ++i) {
            const Eigen::Index k = free_errors_[i];
            double& slope = sums[static_cast<Eigen::Index>(i)];
            Eigen::Index first = 0;
            auto part = parts.begin();
            for (; part != parts.end() && !problem_.laws[part->law].has(k); ++part)
                first += part->records.rows.rows() * problem_.laws[part->law].rows_per_record();
            if (block.rows.size() == 0 && part == parts.end()) continue;
            if (block.rows.size() == 0 && problem_.laws[part->law].compressible()) {
                slope += 2.0 * here.segment(first, part->records.rows.rows()).squaredNorm();  // dS = -S
                continue;
            }
            const WhitenedRows derivative =
                standard_rows_derivative(block, parts, problem_.laws, state_.psi, k, Curvature::expected, {at, 0.0});
            slope -= 2.0 * here.dot(derivative.rows.leftCols(step.size()) * step);
        }
    };
    std::vector<Eigen::VectorXd> sums(pieces_of(minimum_.rows.size()), slopes);
    for_pieces(minimum_.rows.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        Eigen::VectorXd step;
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows& rows = minimum_.rows[b];
            step.resize(rows.latents + v.size());
            step << moved[b] - still[b], v;
            if (point_.standard.own_rows(b).rows() > 0)
                add(rows, rows.parts, point_.standard.own_rows(b), step, sums[piece]);
            if (rows.linked_parts.empty()) continue;
            const auto next = static_cast<std::size_t>(rows.next);
            step.resize(rows.latents + rows.next_latents + v.size());
            step << moved[b] - still[b], moved[next] - still[next], v;
            add(rows, rows.linked_parts, point_.standard.linked_rows(b), step, sums[piece]);
        }
    });
    for (const Eigen::VectorXd& part : sums)
        slopes += part;
    set_.spread.sum(slopes);
    return slopes;
}

Uncertainty Posterior::along(const Eigen::VectorXd& direction) const {
    Uncertainty result{nan_value, nan_value, nan_value, nan_value, IntervalMethod::none};
    const BoundedStep& step = minimum_.step;
    // A direction with a part that nothing decides has no sd; a combination that avoids it has one.
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    const double whole = direction.cwiseProduct(size).lpNorm<Eigen::Infinity>();
    for (const NullDirection& flat : identifiability_.undecided)
        if (!(std::abs(flat.components.cwiseProduct(size).dot(direction)) <= 1e-6 * whole)) return result;
    const Eigen::VectorXd y = step.decided.transpose() * direction;
    if (!(y.lpNorm<Eigen::Infinity>() > 0.0)) return result;
    Eigen::VectorXd c = y;
    models::solve_transposed_upper_in_place(point_.triangle, c);
    double assumed = c.squaredNorm();
    if (moved_by_errors_.size() > 0) assumed = direction.dot(laplace_ * direction);
    result.laplace_sd = std::sqrt(assumed);
    const double variance = slack_.size() > 0 ? std::max(0.0, assumed - y.dot(slack_ * y)) : assumed;
    if (sandwich_) {
        result.sd = std::sqrt(y.dot(sandwich_->covariance() * y));
        result.degrees_of_freedom = sandwich_->degrees_of_freedom(y);
        result.quantile = quantile_975(result.degrees_of_freedom);
        result.method = IntervalMethod::sandwich;
        return result;
    }
    if (spectrum_) {
        const ScoreSpectrum::Ratio ratio = spectrum_->along(c);
        result.method = IntervalMethod::too_few_independent;
        if (!ratio.enough) return result;
        result.sd = std::sqrt(variance * ratio.value);
        result.degrees_of_freedom = ratio.degrees_of_freedom;
        result.quantile = quantile_975(result.degrees_of_freedom);
        result.method = IntervalMethod::sandwich;
        return result;
    }
    result.sd = std::sqrt(variance);
    if (free_errors_.empty()) {
        result.method = IntervalMethod::normal;
        result.quantile = quantile_975(std::numeric_limits<double>::infinity());
    } else if (one_scale_) {
        result.method = IntervalMethod::t;
        result.quantile = t_quantile_;
    } else {
        // Satterthwaite: 2 variance^2 / var(variance).
        const Eigen::VectorXd slopes = variance_slopes(y);
        const Eigen::MatrixXd errors = error_covariance_(free_errors_, free_errors_);
        const auto count = slopes.size();
        double spread = 0.0;
        for (Eigen::Index i = 0; i < count; ++i)
            for (Eigen::Index j = 0; j < count; ++j)
                spread += slopes[i] * slopes[j] * errors(i, j);
        result.method = IntervalMethod::satterthwaite;
        result.quantile = quantile_975(2.0 * assumed * assumed / spread);
    }
    return result;
}

}  // namespace orbid::estimator
