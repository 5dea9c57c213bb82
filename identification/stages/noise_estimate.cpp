#include "identification/stages/noise_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/series_residuals/chain_information.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using estimator::Estimate;
using orbits::Continuity;
using Parameters = std::vector<estimator::FreeParameter>;

bool is_noisy(const orbits::ShootingResidual& residual) {
    return residual.matching().kind == Continuity::Kind::diffusion;
}

/// Index of the first residual with nodes in the order of ProblemResiduals::all().
std::size_t first_shooting(const ProblemResiduals& residuals) {
    return (residuals.cycles ? 1 : 0) + residuals.series.size();
}

VectorXd scales_of(const orbits::ShootingResidual& residual, const Estimate& estimate) {
    const auto& groups = residual.groups();
    VectorXd scales(std::ssize(groups));
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const auto* scale = scale_of(estimate, groups[g].name);
        scales[static_cast<Index>(g)] = scale != nullptr ? scale->value : groups[g].scale.value;
    }
    return scales;
}

/// Some noise above its bound.
bool finds_noise(const ProblemResiduals& residuals, const Estimate& estimate) {
    for (const auto& residual : residuals.shooting) {
        if (!is_noisy(*residual)) continue;
        const auto& groups = residual->groups();
        for (std::size_t g = residual->reading_groups(); g < groups.size(); ++g)
            if (const auto* scale = scale_of(estimate, groups[g].name); scale && std::isfinite(scale->lower95))
                return true;
    }
    return false;
}

/// ln|H| / 2 over the states of all series with process noise, at the best states for theta. nan where flows fail.
double half_ln_information(const ProblemResiduals& residuals, const Estimate& estimate, const VectorXd& theta) {
    double sum = 0.0;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& residual = *residuals.shooting[i];
        if (!is_noisy(residual)) continue;
        const std::size_t at = first_shooting(residuals) + i;
        const estimator::ActiveSet& active = estimate.active[at];
        const VectorXd scales = scales_of(residual, estimate);
        std::vector<VectorXd> states = estimate.latents[at];
        const auto first =
            orbits::chain_information(active.layout, residual.evaluate(active, theta, states, true), scales);
        for (std::size_t b = 0; b < states.size(); ++b)
            if (first.step[b].size() > 0) states[b] += first.step[b];
        sum += orbits::chain_information(active.layout, residual.evaluate(active, theta, states, true), scales)
                   .half_ln_determinant;
    }
    return sum;
}

/// A linear term as a wide prior, and what it adds to the objective beside its slope.
struct Tilt {
    std::vector<std::size_t> place;  ///< of the parameters that have it
    VectorXd slope, mean, sd;

    [[nodiscard]] bool empty() const { return place.empty(); }
};

/// -d ln|dx/du| / dx of the coordinate u in which a parameter is estimated: what a prior has besides its density.
double scale_slope(const estimator::FreeParameter& parameter, double x) {
    if (parameter.scale == estimator::Scale::log || parameter.scale == estimator::Scale::log10) return -1.0 / x;
    if (parameter.scale == estimator::Scale::logit) return 1.0 / (parameter.upper - x) - 1.0 / (x - parameter.lower);
    return 0.0;
}

double ln_scale_slope(const estimator::FreeParameter& parameter, double x) {
    if (parameter.scale == estimator::Scale::log) return std::log(x);
    if (parameter.scale == estimator::Scale::log10) return std::log(x * std::numbers::ln10);
    if (parameter.scale == estimator::Scale::logit)
        return std::log((x - parameter.lower) * (parameter.upper - x) / (parameter.upper - parameter.lower));
    return 0.0;
}

Tilt tilt_at(const Parameters& parameters, const ProblemResiduals& residuals, const Estimate& estimate) {
    constexpr double difference = 0.1, wide = 300.0;  // sds
    Tilt tilt;
    const VectorXd theta = estimated_theta(estimate);
    std::vector<double> slopes;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const double sd = estimate.parameters[i].laplace_sd;
        if (!(sd > 0.0) || !std::isfinite(sd) || parameters[i].lower == parameters[i].upper) continue;
        const auto at = static_cast<Index>(i);
        VectorXd above = theta, below = theta;
        above[at] = std::min(theta[at] + difference * sd, parameters[i].upper);
        below[at] = std::max(theta[at] - difference * sd, parameters[i].lower);
        const double slope =
            (half_ln_information(residuals, estimate, above) - half_ln_information(residuals, estimate, below)) /
            (above[at] - below[at]);
        if (!std::isfinite(slope)) continue;
        tilt.place.push_back(i);
        slopes.push_back(slope - scale_slope(parameters[i], theta[at]));
    }
    const auto count = std::ssize(tilt.place);
    tilt.slope = Eigen::Map<const VectorXd>(slopes.data(), count);
    tilt.mean.resize(count);
    tilt.sd.resize(count);
    for (Index k = 0; k < count; ++k) {
        const std::size_t i = tilt.place[static_cast<std::size_t>(k)];
        tilt.sd[k] = wide * estimate.parameters[i].laplace_sd;
        tilt.mean[k] = theta[static_cast<Index>(i)] - tilt.slope[k] * tilt.sd[k] * tilt.sd[k];
    }
    return tilt;
}

estimator::EstimateOptions with_tilt(estimator::EstimateOptions options, const Parameters& parameters,
                                     const Tilt& tilt) {
    if (tilt.empty()) return options;
    estimator::JointNormalPrior prior;
    for (const std::size_t i : tilt.place)
        prior.names.push_back(parameters[i].name);
    prior.mean = tilt.mean;
    prior.covariance = tilt.sd.cwiseAbs2().asDiagonal();
    options.joint_priors.push_back(std::move(prior));
    return options;
}

/// Takes the tilt out of what the estimate says of itself.
void take_out(const Parameters& parameters, const Tilt& tilt, Estimate& estimate) {
    double added = 0.0;
    for (std::size_t k = 0; k < tilt.place.size(); ++k) {
        const std::size_t i = tilt.place[k];
        const auto at = static_cast<Index>(k);
        const double x = estimate.parameters[i].value;
        const double z = (x - tilt.mean[at]) / tilt.sd[at];
        added += 0.5 * z * z + std::log(tilt.sd[at]) + 0.5 * std::log(2.0 * std::numbers::pi) -
                 ln_scale_slope(parameters[i], x);
    }
    estimate.objective -= added;
    estimate.log_integral += added;
}

/// The same residuals, begun where an estimate has ended.
std::vector<orbits::ShootingResidual> begun_at(const ProblemResiduals& residuals, const Estimate& estimate) {
    std::vector<orbits::ShootingResidual> result;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const std::size_t at = first_shooting(residuals) + i;
        result.push_back(residuals.shooting[i]->with(residuals.shooting[i]->matching(), estimate.active[at],
                                                     estimate.latents[at], estimated_theta(estimate)));
    }
    return result;
}

Estimate again(const Parameters& parameters, const ProblemResiduals& residuals, const Estimate& before,
               const std::vector<estimator::DerivedQuantity>& derived, const estimator::EstimateOptions& options) {
    const std::vector<orbits::ShootingResidual> begun = begun_at(residuals, before);
    std::vector<const estimator::Residual*> all = residuals.all();
    for (std::size_t i = 0; i < begun.size(); ++i)
        all[first_shooting(residuals) + i] = &begun[i];
    Parameters moved = parameters;
    for (std::size_t i = 0; i < moved.size(); ++i)
        moved[i].start = before.parameters[i].value;
    Estimate found = estimator::estimate(moved, all, derived, options);
    found.iterations += before.iterations;
    found.evaluations += before.evaluations;
    return found;
}

double largest_move(const Estimate& before, const Estimate& now) {
    double largest = 0.0;
    for (std::size_t i = 0; i < now.parameters.size(); ++i)
        if (now.parameters[i].laplace_sd > 0.0)
            largest = std::max(
                largest, std::abs(now.parameters[i].value - before.parameters[i].value) / now.parameters[i].laplace_sd);
    return largest;
}

bool is_over(const Estimate& estimate) {
    return estimate.status == estimator::EstimateStatus::failed ||
           estimate.status == estimator::EstimateStatus::interrupted;
}

void refuse_priors(const Parameters& parameters, const estimator::EstimateOptions& options) {
    for (const auto& parameter : parameters)
        if (estimator::is_proper(parameter.prior) || !options.joint_priors.empty())
            throw orbits::DataError(fmt::format(
                "process noise is estimated without priors of parameters: leave out that of {}",
                options.joint_priors.empty() ? parameter.name : options.joint_priors.front().names.front()));
}

}  // namespace

bool has_process_noise(const ProblemResiduals& residuals) {
    return std::any_of(residuals.shooting.begin(), residuals.shooting.end(),
                       [](const auto& residual) { return is_noisy(*residual); });
}

Estimate estimate_with_noise(const Parameters& parameters, const ProblemResiduals& residuals,
                             const std::vector<estimator::DerivedQuantity>& derived,
                             const estimator::EstimateOptions& options) {
    constexpr int most_rounds = 30;
    constexpr double still = 1e-4;  // sds
    refuse_priors(parameters, options);
    estimator::EstimateOptions quick = options;
    quick.verdict = false;
    Estimate found = estimator::estimate(parameters, residuals.all(), {}, quick);
    if (is_over(found)) return found;
    Tilt tilt;
    const auto goes_on = [&] {
        return found.status == estimator::EstimateStatus::converged && finds_noise(residuals, found);
    };
    double move = 1.0;
    for (int round = 0; round < most_rounds && goes_on() && move > still; ++round) {
        tilt = tilt_at(parameters, residuals, found);
        Estimate next = again(parameters, residuals, found, {}, with_tilt(quick, parameters, tilt));
        move = largest_move(found, next);
        found = std::move(next);
        if (is_over(found)) return found;
    }
    if (!finds_noise(residuals, found)) tilt = {};
    const bool settled = !goes_on() || move <= still;
    found = again(parameters, residuals, found, derived, with_tilt(options, parameters, tilt));
    take_out(parameters, tilt, found);
    if (!settled && found.status == estimator::EstimateStatus::converged) {
        found.status = estimator::EstimateStatus::no_progress;
        found.message += fmt::format("; the information of the states still moves parameters by {:.2g} sds", move);
    }
    return found;
}

}  // namespace orbid::identification
