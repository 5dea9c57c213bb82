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
    if (!(degrees < 1e9)) return boost::math::quantile(boost::math::normal(), 0.975);
    return boost::math::quantile(boost::math::students_t(std::max(degrees, 1.0)), 0.975);
}

}  // namespace

Posterior::Posterior(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum)
    : problem_(problem), set_(set), state_(state), minimum_(minimum) {
    const Eigen::Index q = state.u.size();
    const auto channels = static_cast<Eigen::Index>(problem.channels.size());
    const Eigen::VectorXd scale = state.ln_scale.array().exp();
    const BoundedStep& step = minimum.step;
    const ScaleProblem scales = scale_problem(problem, set, minimum.rows, minimum.prior, step, false);
    point_ = evaluate_scales(scales, state.ln_scale);
    arrow_ = whitened_arrow(minimum.rows, scale);
    condensed_ = condense(arrow_, 0.0);

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
    identifiability_ = identifiability(condensed_.r, step, size, column_size);

    Eigen::Index dead = 0;
    for (const BlockTriangle& block : arrow_.blocks)
        dead += std::count(block.dead.begin(), block.dead.end(), true);
    degrees_of_freedom_ = static_cast<double>(set.records - (set.latents - dead) - step.space.data.cols());

    // Scales: inverse of their joint expected information.
    std::vector<Eigen::Index> free;
    Eigen::Index present = 0;
    for (Eigen::Index c = 0; c < channels; ++c) {
        if (set.count[c] > 0.0) ++present;
        if (scales.free[static_cast<std::size_t>(c)] && !minimum.scale_at_floor[static_cast<std::size_t>(c)])
            free.push_back(c);
    }
    estimated_scales_ = static_cast<int>(free.size());
    one_scale_ = present == 1 && estimated_scales_ == 1;
    ln_scale_sd_ = Eigen::VectorXd::Zero(channels);
    ln_scale_covariance_ = Eigen::MatrixXd::Zero(channels, channels);
    if (!free.empty()) {
        const auto count = static_cast<Eigen::Index>(free.size());
        Eigen::MatrixXd information(count, count);
        for (Eigen::Index i = 0; i < count; ++i)
            for (Eigen::Index j = 0; j < count; ++j)
                information(i, j) =
                    point_.information(free[static_cast<std::size_t>(i)], free[static_cast<std::size_t>(j)]);
        const Eigen::LDLT<Eigen::MatrixXd> factor(information);
        const bool definite =
            factor.info() == Eigen::Success && factor.isPositive() && factor.vectorD().minCoeff() > 0.0;
        const Eigen::MatrixXd inverse = definite
                                            ? Eigen::MatrixXd(factor.solve(Eigen::MatrixXd::Identity(count, count)))
                                            : Eigen::MatrixXd::Constant(count, count, nan_value);
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index g = free[static_cast<std::size_t>(i)];
            ln_scale_sd_[g] = std::sqrt(inverse(i, i));
            for (Eigen::Index j = 0; j < count; ++j)
                ln_scale_covariance_(g, free[static_cast<std::size_t>(j)]) = inverse(i, j);
        }
    }

    look_for_autocorrelation();
    make_sandwich();

    // Latent states given theta, plus what the uncertainty of theta adds: R_zz^-1 (I + R_z C R_z^T) R_zz^-T.
    for (std::size_t b = 0; b < arrow_.blocks.size(); ++b) {
        const Eigen::Index l = arrow_.blocks[b].latents;
        const auto r_zz = condensed_.top[b].leftCols(l).triangularView<Eigen::Upper>();
        Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(l, l);
        r_zz.solveInPlace(inverse);
        const Eigen::MatrixXd through = inverse * condensed_.top[b].middleCols(l, q);
        Eigen::VectorXd variance = inverse.rowwise().squaredNorm();
        variance += (through * covariance_).cwiseProduct(through).rowwise().sum();
        for (Eigen::Index j = 0; j < l; ++j)
            if (arrow_.blocks[b].dead[static_cast<std::size_t>(j)]) variance[j] = nan_value;
        latent_sds_.emplace_back(variance.cwiseSqrt());
    }
}

void Posterior::look_for_autocorrelation() {
    for (std::size_t c = 0; c < problem_.channels.size(); ++c) {
        const Channel& channel = problem_.channels[c];
        const Group& group = problem_.residuals[channel.residual]->groups()[static_cast<std::size_t>(channel.group)];
        if (!group.ordered) {
            autocorrelations_.emplace_back();
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
    }
}

void Posterior::make_sandwich() {
    double longest = 0.0;
    for (const Autocorrelation& correlation : autocorrelations_)
        if (correlation.significant) longest = std::max(longest, correlation.records);
    if (!(longest > 0.0) || point_.triangle.rows() == 0) return;
    // Clusters of twice the integrated correlation time: about four times the decay time of an AR(1).
    const double length = 2.0 * longest;
    std::vector<std::vector<int>> clusters;
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
    const double inflation = 1.0 / (1.0 - decay / length * -std::expm1(-length / decay));
    const auto rows = linearise(set_, minimum_.evaluation.values, problem_.coordinates, state_.theta, false);
    sandwich_ = std::make_unique<Sandwich>(in_basis(rows, minimum_.step.from_data), clusters,
                                           state_.ln_scale.array().exp(), point_.triangle, inflation);
    covariance_ = minimum_.step.decided * sandwich_->covariance() * minimum_.step.decided.transpose();
}

double Posterior::objective() const {
    double value = point_.value + 0.5 * set_.ln_det_shapes + minimum_.prior.value;
    // The factor is taken in equilibrated coordinates; their units bring it back to u.
    if (problem_.options.variance == Variance::restricted) value += minimum_.step.space.unit.array().log().sum();
    return value;
}

double Posterior::log_likelihood() const {
    double value = -0.5 * static_cast<double>(set_.records) * std::log(2.0 * std::numbers::pi) -
                   set_.count.dot(state_.ln_scale) - 0.5 * set_.ln_det_shapes;
    for (const BlockTriangle& block : arrow_.blocks)
        value -= 0.5 * block.triangle.rightCols(1).squaredNorm();
    return value;
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
    const double variance = c.squaredNorm();
    result.laplace_sd = std::sqrt(variance);
    if (sandwich_) {
        result.sd = std::sqrt(y.dot(sandwich_->covariance() * y));
        result.quantile = quantile_975(sandwich_->degrees_of_freedom(y));
        result.method = "sandwich";
        return result;
    }
    result.sd = result.laplace_sd;
    if (estimated_scales_ == 0) {
        result.method = "normal";
        result.quantile = quantile_975(std::numeric_limits<double>::infinity());
    } else if (one_scale_) {
        result.method = "t";
        result.quantile = quantile_975(degrees_of_freedom_);
    } else {
        // Satterthwaite: 2 variance^2 / var(variance), d variance / d ln s_g = 2 c^T K_g c.
        const auto channels = static_cast<Eigen::Index>(point_.share.size());
        Eigen::VectorXd gradient(channels);
        for (Eigen::Index g = 0; g < channels; ++g)
            gradient[g] = 2.0 * c.dot(point_.share[static_cast<std::size_t>(g)] * c);
        result.method = "satterthwaite";
        result.quantile = quantile_975(2.0 * variance * variance / gradient.dot(ln_scale_covariance_ * gradient));
    }
    return result;
}

bool Posterior::normal_enough(int& evaluations) const {
    constexpr double reach = 1.5;
    const double predicted = 0.5 * reach * reach;
    for (const Eigen::Index i : minimum_.step.free) {
        const double variance = laplace_(i, i);
        if (!(variance > 0.0) || identifiability_.undetermined[static_cast<std::size_t>(i)]) continue;
        for (const double sign : {-1.0, 1.0}) {
            const Eigen::VectorXd d = sign * reach / std::sqrt(variance) * laplace_.col(i);
            State trial = state_;
            trial.u += d;
            if ((trial.u.array() < problem_.lower.array()).any() || (trial.u.array() > problem_.upper.array()).any())
                return false;
            for (Eigen::Index k = 0; k < d.size(); ++k)
                trial.theta[k] = problem_.coordinates[static_cast<std::size_t>(k)].natural(trial.u[k]);
            const auto d_z = latent_steps(arrow_, condensed_, d);
            for (std::size_t b = 0; b < set_.blocks.size(); ++b)
                trial.latents[set_.blocks[b].residual][set_.blocks[b].block] += d_z[b];
            double change = prior_at(problem_, trial.u).value - minimum_.prior.value;
            if (!std::isfinite(change)) return false;
            const Evaluation evaluation = evaluate(problem_.residuals, set_, trial.theta, trial.latents, false);
            ++evaluations;
            if (!evaluation.failed.empty()) return false;
            for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
                Eigen::MatrixXd pair(evaluation.values[b].e.size(), 2);
                pair << evaluation.values[b].e - minimum_.evaluation.values[b].e,
                    evaluation.values[b].e + minimum_.evaluation.values[b].e;
                whiten(set_.blocks[b].channel, set_.blocks[b].cholesky, state_.ln_scale.array().exp(), pair);
                change += 0.5 * pair.col(0).dot(pair.col(1));
            }
            if (!(change > 0.5 * predicted && change < 2.0 * predicted)) return false;
        }
    }
    return true;
}

}  // namespace orbid::estimator
