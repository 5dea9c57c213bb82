#include "estimator/posterior.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/Cholesky>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

namespace orbid::estimator {

namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

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
    point_.triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(half);
    laplace_ = half.transpose() * half;
    covariance_ = laplace_;

    const Eigen::VectorXd size = sizes(problem, state.theta);
    Eigen::VectorXd column_size = size;
    for (Eigen::Index i = 0; i < q; ++i) {
        const auto index = static_cast<std::size_t>(i);
        const Prior& prior = problem.parameters[index].prior;
        if (is_proper(prior)) column_size[i] = problem.coordinates[index].prior_sd(prior, state.theta[i]);
    }
    arrow_ = standard_arrow(minimum.rows, problem.laws, state.psi, minimum.matching, Curvature::expected).arrow;
    condensed_ = condense(arrow_, 0.0);
    identifiability_ = identifiability(condensed_.r, step, size, column_size);

    Eigen::Index dead = 0;
    for (const BlockTriangle& block : arrow_.blocks)
        dead += std::count(block.dead.begin(), block.dead.end(), true);
    degrees_of_freedom_ =
        static_cast<double>(set.records - (set.latents - dead - set.constraints) - step.space.data.cols());
    error_parameters();
    look_for_autocorrelation();
    make_sandwich();

    // Latent states with what the uncertainty of theta adds.
    const std::vector<Eigen::MatrixXd> around = covariance_around(arrow_, condensed_, covariance_).block;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const Eigen::Index l = set.blocks[b].latents;
        Eigen::VectorXd variance = around[b].diagonal().head(l);
        for (Eigen::Index j = 0; j < l; ++j)
            if (arrow_.blocks[b].dead[static_cast<std::size_t>(j)]) variance[j] = nan_value;
        latent_sds_.emplace_back(variance.cwiseSqrt());
    }
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
                 std::any_of(problem_.laws.begin(), problem_.laws.end(), [this](const ErrorLaw& law) {
                     return law.first == free_errors_.front() && law.compressible();
                 });
    if (free_errors_.empty()) return;
    ErrorProblem profiled = errors_;
    profiled.follow = Follow::all;
    Eigen::MatrixXd hessian = error_hessian(profiled, state_.psi, free_errors_);
    // A logarithm whose sd would be thirty: the objective is flat there, nothing else depends on it, and neither its
    // curvature nor its sd means anything.
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
    const Eigen::LDLT<Eigen::MatrixXd> factor(hessian);
    const bool definite = factor.info() == Eigen::Success && factor.isPositive() && factor.vectorD().minCoeff() > 0.0;
    const Eigen::MatrixXd inverse = definite ? Eigen::MatrixXd(factor.solve(Eigen::MatrixXd::Identity(count, count)))
                                             : Eigen::MatrixXd::Constant(count, count, nan_value);
    ln_error_determinant_ = definite ? factor.vectorD().array().log().sum() : nan_value;
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < count; ++j)
            error_covariance_(free_errors_[static_cast<std::size_t>(i)], free_errors_[static_cast<std::size_t>(j)]) =
                inverse(i, j);
    add_error_uncertainty();
}

/// Where theta and psi inform each other in expectation (relative errors), or where the posterior of psi is part of
/// what is asked for (integrated): Cov(theta) = E Cov(theta | psi) + Cov E(theta | psi), with the slope of the
/// conditional mode, d y / d psi = -H^-1 d(S^T s) / d psi.
void Posterior::add_error_uncertainty() {
    const bool integrated = problem_.options.variance == Variance::integrated;
    const Eigen::Index rank = point_.triangle.rows();
    moved_by_errors_ = Eigen::MatrixXd::Zero(rank, static_cast<Eigen::Index>(free_errors_.size()));
    if (rank == 0) return;
    bool any = false;
    for (std::size_t i = 0; i < free_errors_.size(); ++i) {
        const Eigen::Index k = free_errors_[i];
        const auto law = std::find_if(problem_.laws.begin(), problem_.laws.end(), [k](const ErrorLaw& candidate) {
            return k >= candidate.first &&
                   k < candidate.first + static_cast<Eigen::Index>(candidate.coordinates.size());
        });
        if (!integrated && !std::holds_alternative<RelativeErrors>(law->distribution)) continue;
        any = true;
        // Gradient of the condensed problem with respect to y, by its change with psi: central differences of
        // S_y^T s - (latent part), with the latent states following.
        constexpr double h = 1e-5;
        Eigen::VectorXd difference = Eigen::VectorXd::Zero(rank);
        for (const double sign : {-1.0, 1.0}) {
            Eigen::VectorXd shifted = state_.psi;
            shifted[k] += sign * h;
            const Condensed condensed = condense(
                standard_arrow(errors_.rows, problem_.laws, shifted, minimum_.matching, Curvature::expected).arrow,
                0.0);
            difference += sign / (2.0 * h) * (condensed.r.transpose() * condensed.rhs);
        }
        const auto r = point_.triangle.triangularView<Eigen::Upper>();
        point_.triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(difference);
        r.solveInPlace(difference);
        moved_by_errors_.col(static_cast<Eigen::Index>(i)) = -difference;
    }
    if (!any) return;
    Eigen::MatrixXd errors(static_cast<Eigen::Index>(free_errors_.size()),
                           static_cast<Eigen::Index>(free_errors_.size()));
    for (std::size_t i = 0; i < free_errors_.size(); ++i)
        for (std::size_t j = 0; j < free_errors_.size(); ++j)
            errors(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
                error_covariance_(free_errors_[i], free_errors_[j]);
    const Eigen::MatrixXd through = minimum_.step.decided * moved_by_errors_;
    laplace_ += through * errors * through.transpose();
    covariance_ = laplace_;
}

void Posterior::look_for_autocorrelation() {
    for (std::size_t c = 0; c < problem_.channels.size(); ++c) {
        const Channel& channel = problem_.channels[c];
        const Group& group = problem_.residuals[channel.residual]->groups()[static_cast<std::size_t>(channel.group)];
        if (!group.ordered) {
            autocorrelations_.emplace_back();
            unexplained_.emplace_back();
            continue;
        }
        std::vector<Eigen::VectorXd> sequences;
        for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
            const ActiveBlock& block = set_.blocks[b];
            std::vector<double> own;
            for (std::size_t i = 0; i < block.channel.size(); ++i)
                if (block.channel[i] == static_cast<int>(c))
                    own.push_back(minimum_.evaluation.values[b].e[static_cast<Eigen::Index>(i)]);
            if (!own.empty())
                sequences.emplace_back(
                    Eigen::Map<const Eigen::VectorXd>(own.data(), static_cast<Eigen::Index>(own.size())));
        }
        autocorrelations_.push_back(autocorrelation(sequences));
        unexplained_.push_back(std::holds_alternative<AutoregressiveErrors>(group.distribution)
                                   ? autocorrelation(innovations(static_cast<int>(c)))
                                   : autocorrelations_.back());
    }
}

/// The innovations of a channel with autoregressive errors, block by block: independent when the law is right.
std::vector<Eigen::VectorXd> Posterior::innovations(int channel) const {
    std::vector<Eigen::VectorXd> sequences;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        for (const std::vector<LawPart>* parts : {&set_.blocks[b].parts, &set_.blocks[b].linked_parts})
            for (const LawPart& part : *parts) {
                const ErrorLaw& law = problem_.laws[part.law];
                if (law.channels.front() != channel || part.records.empty()) continue;
                const Eigen::VectorXd e = law_errors(set_.blocks[b], part, law, minimum_.evaluation.values[b].e);
                const Eigen::VectorXd psi =
                    state_.psi.segment(law.first, static_cast<Eigen::Index>(law.coordinates.size()));
                sequences.push_back(standard_errors(law, e, part.observed, psi));
            }
    }
    return sequences;
}

void Posterior::make_sandwich() {
    const Clusters choice = problem_.options.clusters;
    if (choice == Clusters::none || point_.triangle.rows() == 0) return;
    std::vector<std::vector<int>> clusters;
    double inflation = 1.0;
    if (choice == Clusters::blocks) {
        std::size_t count = 0;
        for (const ActiveBlock& block : set_.blocks) {
            clusters.emplace_back(block.channel.size(), 0);
            if (!block.channel.empty()) ++count;
        }
        const auto least = static_cast<std::size_t>(point_.triangle.rows()) + 1;
        if (set_.constraints > 0 || set_.linked || count < least) {
            sandwich_note_ = (set_.constraints > 0 ? std::string("constraints link the blocks")
                              : set_.linked        ? std::string("records link the blocks")
                                                   : "blocks are too few (" + std::to_string(count) + ", at least " +
                                                  std::to_string(least) + " are needed)") +
                             ": no clusters, intervals as if errors were independent";
            return;
        }
        sandwich_note_ = "intervals from " + std::to_string(count) + " blocks as clusters";
    } else {
        inflation = correlated_clusters(clusters);
        if (clusters.empty()) return;
        std::size_t count = 0;
        for (const std::vector<int>& cluster : clusters)
            if (!cluster.empty())
                count += 1 + static_cast<std::size_t>(*std::max_element(cluster.begin(), cluster.end()));
        // Scores of all clusters add up to zero: of so few some direction would have no scatter, and so no uncertainty.
        if (count <= static_cast<std::size_t>(point_.triangle.rows())) {
            widen(count);
            return;
        }
    }
    const auto rows =
        linearise(set_, problem_.laws, minimum_.evaluation.values, problem_.coordinates, state_.theta, false);
    sandwich_ = std::make_unique<Sandwich>(in_basis(rows, minimum_.step.from_data), set_, clusters, problem_.laws,
                                           state_.psi, point_.triangle, inflation);
    covariance_ = minimum_.step.decided * sandwich_->covariance() * minimum_.step.decided.transpose();
    if (choice == Clusters::automatic)
        sandwich_note_ = "residuals are autocorrelated: intervals from " + std::to_string(sandwich_->clusters()) +
                         " clusters of consecutive records";
}

/// Laplace's covariance as if each of the records that are worth an independent one stood for all that repeat it.
void Posterior::widen(std::size_t clusters) {
    const auto n = static_cast<double>(set_.records);
    double longest = 1.0;
    for (const Autocorrelation& correlation : unexplained_)
        if (correlation.significant) longest = std::max(longest, std::min(correlation.records, n));
    widening_ = longest;
    covariance_ *= widening_;
    widened_degrees_of_freedom_ = std::max(1.0, n / longest - static_cast<double>(point_.triangle.rows()));
    sandwich_note_ = "residuals repeat each other over most of a record, which makes " + std::to_string(clusters) +
                     (clusters == 1 ? " cluster" : " clusters") +
                     ", too few for a scatter: intervals from the number of independent records";
}

/// Clusters of consecutive records where residuals are autocorrelated beyond what their law says; none otherwise.
/// @return factor on the covariance for correlation across the borders of clusters.
double Posterior::correlated_clusters(std::vector<std::vector<int>>& clusters) const {
    double longest = 0.0;
    for (const Autocorrelation& correlation : unexplained_)
        if (correlation.significant) longest = std::max(longest, correlation.records);
    if (!(longest > 0.0) || set_.constraints > 0 || set_.linked) return 1.0;
    // Clusters of twice the integrated correlation time: about four times the decay time of an AR(1).
    const double length = 2.0 * longest;
    for (const ActiveBlock& block : set_.blocks) {
        double most = 0.0;
        for (std::size_t c = 0; c < problem_.channels.size(); ++c) {
            const Group& group = problem_.residuals[problem_.channels[c].residual]
                                     ->groups()[static_cast<std::size_t>(problem_.channels[c].group)];
            if (group.ordered)
                most = std::max(most, static_cast<double>(
                                          std::count(block.channel.begin(), block.channel.end(), static_cast<int>(c))));
        }
        clusters.push_back(consecutive_clusters(block.channel, std::max(1, static_cast<int>(most / length))));
    }
    // Correlation across the borders of clusters, AR(1) with the same integrated time tau = 2 decay times: a sum over
    // L records has the share 1 - (decay / L)(1 - exp(-L / decay)) of the variance it would have with all neighbours.
    const double decay = 0.5 * longest;
    return 1.0 / (1.0 - decay / length * -std::expm1(-length / decay));
}

double Posterior::objective() const {
    // (M8) leaves out the constants of the normal density.
    double value = point_.value + 0.5 * set_.ln_det_shapes + minimum_.prior.value -
                   0.5 * std::log(2.0 * std::numbers::pi) * static_cast<double>(set_.records);
    // The factor is taken in equilibrated coordinates; their units bring it back to u.
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
    return value;
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
    point_.triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(v);
    point_.triangle.triangularView<Eigen::Upper>().solveInPlace(v);
    // Latent states that follow v, without what their own residuals ask for.
    const std::vector<Eigen::VectorXd> still =
        latent_steps(point_.standard.arrow, point_.condensed, Eigen::VectorXd::Zero(v.size()));
    const std::vector<Eigen::VectorXd> moved = latent_steps(point_.standard.arrow, point_.condensed, v);
    Eigen::VectorXd slopes = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(free_errors_.size()));
    const auto add = [&](const StandardRows<double>& at, const Eigen::VectorXd& step, const auto& derivative_of) {
        const Eigen::VectorXd here = at.rows.leftCols(step.size()) * step;
        for (std::size_t i = 0; i < free_errors_.size(); ++i)
            slopes[static_cast<Eigen::Index>(i)] -=
                2.0 * here.dot(derivative_of(free_errors_[i]).rows.leftCols(step.size()) * step);
    };
    for (std::size_t b = 0; b < errors_.rows.size(); ++b) {
        const BlockRows& rows = errors_.rows[b];
        const StandardRows<double>& at = point_.standard.rows[b];
        if (at.rows.rows() > 0) {
            Eigen::VectorXd step(rows.latents + v.size());
            step << moved[b] - still[b], v;
            add(at, step, [&](Eigen::Index k) {
                return standard_rows_derivative(rows, problem_.laws, state_.psi, k, Curvature::expected, at);
            });
        }
        const StandardRows<double>& linked = point_.standard.linked_rows[b];
        if (linked.rows.rows() == 0) continue;
        const auto next = static_cast<std::size_t>(rows.next);
        Eigen::VectorXd step(rows.latents + rows.next_latents + v.size());
        step << moved[b] - still[b], moved[next] - still[next], v;
        add(linked, step, [&](Eigen::Index k) {
            return standard_rows_derivative(rows.linked_parts, problem_.laws, state_.psi, k, Curvature::expected,
                                            linked);
        });
    }
    return slopes;
}

Uncertainty Posterior::along(const Eigen::VectorXd& direction) const {
    Uncertainty result{nan_value, nan_value, nan_value, "none"};
    const BoundedStep& step = minimum_.step;
    // A direction with a part that nothing decides has no sd; a combination that avoids it has one.
    const Eigen::VectorXd size = sizes(problem_, state_.theta);
    const double whole = direction.cwiseProduct(size).lpNorm<Eigen::Infinity>();
    for (const NullDirection& flat : identifiability_.undecided)
        if (!(std::abs(flat.components.cwiseProduct(size).dot(direction)) <= 1e-6 * whole)) return result;
    const Eigen::VectorXd y = step.decided.transpose() * direction;
    if (!(y.lpNorm<Eigen::Infinity>() > 0.0)) return result;
    Eigen::VectorXd c = y;
    point_.triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(c);
    double variance = c.squaredNorm();
    if (moved_by_errors_.size() > 0) variance = direction.dot(laplace_ * direction);
    result.laplace_sd = std::sqrt(variance);
    if (sandwich_) {
        result.sd = std::sqrt(y.dot(sandwich_->covariance() * y));
        result.quantile = quantile_975(sandwich_->degrees_of_freedom(y));
        result.method = "sandwich";
        return result;
    }
    if (widening_ > 1.0) {
        result.sd = result.laplace_sd * std::sqrt(widening_);
        result.quantile = quantile_975(widened_degrees_of_freedom_);
        result.method = "effective_count";
        return result;
    }
    result.sd = result.laplace_sd;
    if (free_errors_.empty()) {
        result.method = "normal";
        result.quantile = quantile_975(std::numeric_limits<double>::infinity());
    } else if (one_scale_) {
        result.method = "t";
        // Only the restricted scale is the root of the sum of squares over the degrees of freedom; the others divide by
        // what the parameters take as well. The interval is that of the t statistic all the same.
        const double taken = problem_.options.variance == Variance::restricted
                                 ? 0.0
                                 : static_cast<double>(minimum_.step.space.data.cols());
        result.quantile = quantile_975(degrees_of_freedom_) * std::sqrt(1.0 + taken / degrees_of_freedom_);
    } else {
        // Satterthwaite: 2 variance^2 / var(variance).
        const Eigen::VectorXd slopes = variance_slopes(y);
        const auto count = slopes.size();
        double spread = 0.0;
        for (Eigen::Index i = 0; i < count; ++i)
            for (Eigen::Index j = 0; j < count; ++j)
                spread += slopes[i] * slopes[j] *
                          error_covariance_(free_errors_[static_cast<std::size_t>(i)],
                                            free_errors_[static_cast<std::size_t>(j)]);
        result.method = "satterthwaite";
        result.quantile = quantile_975(2.0 * variance * variance / spread);
    }
    return result;
}

}  // namespace orbid::estimator
