#include "estimator/exploration/tilt.hpp"

#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "estimator/exploration/redrawn_residual.hpp"
#include "estimator/exploration/replication.hpp"

namespace orbid::estimator {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// -d ln|dx/du| / dx of the coordinate u in which a parameter is estimated: what a prior has besides its density.
double scale_slope(const FreeParameter& parameter, double x) {
    if (parameter.scale == Scale::log || parameter.scale == Scale::log10) return -1.0 / x;
    if (parameter.scale == Scale::logit) return 1.0 / (parameter.upper - x) - 1.0 / (x - parameter.lower);
    return 0.0;
}

double ln_scale_slope(const FreeParameter& parameter, double x) {
    if (parameter.scale == Scale::log) return std::log(x);
    if (parameter.scale == Scale::log10) return std::log(x * std::numbers::ln10);
    if (parameter.scale == Scale::logit)
        return std::log((x - parameter.lower) * (parameter.upper - x) / (parameter.upper - parameter.lower));
    return 0.0;
}

}  // namespace

Tilt::Tilt(const std::vector<FreeParameter>& parameters, const Estimate& estimate, const VectorXd& slope) {
    constexpr double wide = 300.0;  // sds
    std::vector<double> means, variances;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const Estimated& one = estimate.parameters[i];
        const double sd = wide * one.laplace_sd;
        if (std::isnan(slope[static_cast<Index>(i)]) || !(sd > 0.0) || !std::isfinite(sd)) continue;
        const double rest = slope[static_cast<Index>(i)] - scale_slope(parameters[i], one.value);
        place_.push_back(i);
        prior_.names.push_back(parameters[i].name);
        means.push_back(one.value - rest * sd * sd);
        variances.push_back(sd * sd);
    }
    prior_.mean = Eigen::Map<const VectorXd>(means.data(), std::ssize(means));
    prior_.covariance = Eigen::Map<const VectorXd>(variances.data(), std::ssize(variances)).asDiagonal();
}

EstimateOptions Tilt::with(EstimateOptions options) const {
    if (!empty()) options.joint_priors.push_back(prior_);
    return options;
}

void Tilt::take_out(const std::vector<FreeParameter>& parameters, Estimate& estimate) const {
    double added = 0.0;
    for (std::size_t k = 0; k < place_.size(); ++k) {
        const auto at = static_cast<Index>(k);
        const double x = estimate.parameters[place_[k]].value;
        const double sd = std::sqrt(prior_.covariance(at, at));
        const double z = (x - prior_.mean[at]) / sd;
        added += 0.5 * z * z + std::log(sd) + 0.5 * std::log(2.0 * std::numbers::pi) -
                 ln_scale_slope(parameters[place_[k]], x);
    }
    estimate.objective -= added;
    estimate.log_integral += added;
}

Estimate estimate_again(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                        const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                        const Estimate& before) {
    std::vector<ActiveSet> sets = ended_sets(before);
    std::vector<std::unique_ptr<RedrawnResidual>> owned;
    std::vector<const Residual*> same;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        std::vector<VectorXd> none;
        for (const BlockValue& value : before.residuals[r])
            none.emplace_back(VectorXd::Zero(value.e.size()));
        owned.push_back(std::make_unique<RedrawnResidual>(*residuals[r], std::move(sets[r]), std::move(none)));
        same.push_back(owned.back().get());
    }
    std::vector<FreeParameter> begun = parameters;
    for (std::size_t i = 0; i < begun.size(); ++i)
        if (begun[i].tied_to.empty()) begun[i].start = before.parameters[i].value;
    Estimate found = estimate(begun, same, derived, options);
    found.counts = before.counts;
    found.iterations += before.iterations;
    found.evaluations += before.evaluations;
    found.rounds += before.rounds;
    found.history.insert(found.history.begin(), before.history.begin(), before.history.end());
    return found;
}

}  // namespace orbid::estimator
