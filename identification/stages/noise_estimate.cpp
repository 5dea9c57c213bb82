#include "identification/stages/noise_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <fmt/format.h>

#include "estimator/exploration/tilt.hpp"
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
        const std::size_t at = residuals.first_shooting() + i;
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

/// Slopes of half_ln_information(), by central differences of a tenth of a sd; nan of what is not determined.
VectorXd information_slope(const Parameters& parameters, const ProblemResiduals& residuals, const Estimate& estimate) {
    constexpr double difference = 0.1;  // sds
    const VectorXd theta = estimated_theta(estimate);
    VectorXd slope = VectorXd::Constant(theta.size(), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const double sd = estimate.parameters[i].laplace_sd;
        if (!(sd > 0.0) || !std::isfinite(sd) || parameters[i].lower == parameters[i].upper) continue;
        const auto at = static_cast<Index>(i);
        VectorXd above = theta, below = theta;
        above[at] = std::min(theta[at] + difference * sd, parameters[i].upper);
        below[at] = std::max(theta[at] - difference * sd, parameters[i].lower);
        slope[at] =
            (half_ln_information(residuals, estimate, above) - half_ln_information(residuals, estimate, below)) /
            (above[at] - below[at]);
    }
    return slope;
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
    estimator::Tilt tilt;
    const auto goes_on = [&] {
        return found.status == estimator::EstimateStatus::converged && finds_noise(residuals, found);
    };
    double move = 1.0;
    for (int round = 0; round < most_rounds && goes_on() && move > still; ++round) {
        tilt = estimator::Tilt(parameters, found, information_slope(parameters, residuals, found));
        Estimate next = estimator::estimate_again(parameters, residuals.all(), {}, tilt.with(quick), found);
        move = largest_move(found, next);
        found = std::move(next);
        if (is_over(found)) return found;
    }
    if (!finds_noise(residuals, found)) tilt = {};
    const bool settled = !goes_on() || move <= still;
    found = estimator::estimate_again(parameters, residuals.all(), derived, tilt.with(options), found);
    tilt.take_out(parameters, found);
    if (!settled && found.status == estimator::EstimateStatus::converged) {
        found.status = estimator::EstimateStatus::no_progress;
        found.message += fmt::format("; the information of the states still moves parameters by {:.2g} sds", move);
    }
    return found;
}

}  // namespace orbid::identification
