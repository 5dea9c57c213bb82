#include "estimator/exploration/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/errors/noise_model.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/block_set.hpp"
#include "estimator/problem/tie.hpp"

namespace orbid::estimator {

namespace {

/// log10 is log in other units.
std::string coordinate_name(Scale scale) {
    return scale == Scale::linear ? "linear" : scale == Scale::logit ? "logit" : "log";
}

std::string coordinate_name(ErrorCoordinate::Kind kind) {
    using Kind = ErrorCoordinate::Kind;
    return kind == Kind::linear ? "linear" : kind == Kind::fisher ? "atanh" : "log";
}

/// Share of the density below x, from the quantiles by bisection.
double prior_cdf(const Prior& prior, double x) {
    const Support ends = support(prior);
    if (!(x > ends.lower)) return 0.0;
    if (!(x < ends.upper)) return 1.0;
    double lower = 0.0;
    double upper = 1.0;
    // To the last bit of a double near 1.
    for (int halving = 0; halving < 60; ++halving) {
        const double middle = 0.5 * (lower + upper);
        (quantile(prior, middle) < x ? lower : upper) = middle;
    }
    return 0.5 * (lower + upper);
}

Evidence refused(const std::string& message) {
    return {false, nan_value, 0.0, message};
}

std::string in_words(const ImproperPrior& prior) {
    return "the prior of " + prior.name + " is flat (" + prior.coordinate + "): it needs a proper one";
}

}  // namespace

EvidenceTerms evidence_terms(const std::vector<FreeParameter>& parameters,
                             const std::vector<const Residual*>& residuals, const EstimateOptions& options,
                             const Estimate& estimate) {
    EvidenceTerms terms;
    terms.log_integral = estimate.log_integral;
    const bool unfinished =
        estimate.status == EstimateStatus::no_progress || estimate.status == EstimateStatus::iteration_limit;
    if (unfinished && estimate.remaining <= unfinished_sds)
        terms.excess = 0.5 * estimate.remaining * estimate.remaining;
    else if (estimate.status != EstimateStatus::converged)
        terms.obstacle = "the estimate has status " + std::string(name(estimate.status)) + ": " + estimate.message;
    for (const FreeParameter& parameter : parameters) {
        if (!parameter.tied_to.empty() || is_held(parameter)) continue;
        const bool joint =
            std::any_of(options.joint_priors.begin(), options.joint_priors.end(), [&](const JointNormalPrior& prior) {
                return std::find(prior.names.begin(), prior.names.end(), parameter.name) != prior.names.end();
            });
        if (!joint && !is_proper(parameter.prior))
            terms.improper.push_back({parameter.name, coordinate_name(parameter.scale)});
        if (!joint && is_proper(parameter.prior)) {
            const double inside =
                prior_cdf(parameter.prior, parameter.upper) - prior_cdf(parameter.prior, parameter.lower);
            terms.log_integral -= std::log(inside);
        }
    }
    for (const Estimated& parameter : estimate.parameters)
        if (parameter.at_bound != BoundSide::none && terms.obstacle.empty())
            terms.obstacle = parameter.name + " is at its " + std::string(name(parameter.at_bound)) +
                             " bound, where Laplace's integral does not hold";
    std::vector<std::string> groups;
    for (const Residual* residual : residuals)
        for (const Group& group : residual->groups())
            groups.push_back(group.name);
    // Priors are the same in all sets.
    for (const NoiseModel& law : error_laws(residuals, initial_sets(residuals))) {
        if (law.joint()) {
            if (law.inverse_wishart_dof > 0.0) continue;
            std::string together;
            for (const int channel : law.channels)
                together += (together.empty() ? "" : ", ") + groups[static_cast<std::size_t>(channel)];
            terms.improper.push_back({"covariance of " + together, "log-Cholesky"});
            continue;
        }
        const std::string& group = groups[static_cast<std::size_t>(law.channels.front())];
        for (const ErrorCoordinate& coordinate : law.coordinates)
            if (coordinate.estimate && !is_proper(coordinate.prior))
                terms.improper.push_back({group + "." + coordinate.name, coordinate_name(coordinate.kind)});
    }
    for (const EstimatedScale& scale : estimate.scales)
        terms.records += scale.count;
    return terms;
}

Evidence log_evidence(const EvidenceTerms& model) {
    if (!model.obstacle.empty()) return refused(model.obstacle);
    if (model.excess > 0.0) return refused("the minimisation was not finished");
    if (!model.improper.empty()) return refused(in_words(model.improper.front()));
    return {true, model.log_integral, 0.0, ""};
}

Evidence log_bayes_factor(const EvidenceTerms& a, const EvidenceTerms& b) {
    for (const EvidenceTerms* model : {&a, &b})
        if (!model->obstacle.empty()) return refused(model->obstacle);
    if (a.records != b.records)
        return refused("the models are of different data: " + std::to_string(a.records) + " and " +
                       std::to_string(b.records) + " records");
    for (const auto& [one, other] : {std::pair(&a, &b), std::pair(&b, &a)})
        for (const ImproperPrior& prior : one->improper) {
            const bool shared =
                std::any_of(other->improper.begin(), other->improper.end(), [&prior](const ImproperPrior& theirs) {
                    return prior.name == theirs.name && prior.coordinate == theirs.coordinate;
                });
            if (!shared) return refused(in_words(prior) + " or the same one in both models");
        }
    return {true, a.log_integral - b.log_integral, a.excess + b.excess, ""};
}

}  // namespace orbid::estimator
