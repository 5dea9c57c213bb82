#include "estimator/exploration/bias.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <variant>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

#include "estimator/exploration/replication.hpp"
#include "estimator/exploration/tilt.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/tie.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// What estimates from new records leave, and what is left of the bias, in sds: below what two pairs tell. The rest
/// would cost several times as many steps, for courses fold and single steps are short.
constexpr double rough_step = 0.01;
constexpr double near = 0.05;
/// Where courses fold a minimisation with another slope may end at a kink. One that has converged so near is then
/// taken.
constexpr double near_fold = 0.25;

/// Of added errors, over that of the record's own. With 1 the pendulum's length has the same bias: 1.84 and 1.86 sds in
/// the mean of nine records at noise 2e-2.
constexpr double added_variance = 0.5;

/// Pairs of a second try, over those of the first: where errors are large single estimates do not converge. More pairs
/// tell little more: from record to record the bias found of the length scatters by 0.45 sds with two, 0.39 with six.
constexpr std::size_t second_try = 2;

/// One estimate uses all processors, and several at once the memory of several.
bool is_long(const Estimate& estimate) {
    constexpr std::size_t many = 20'000;
    std::size_t blocks = 0;
    for (const ActiveSet& set : estimate.active)
        blocks += set.layout.size();
    return blocks > many;
}

VectorXd values_of(const Estimate& estimate) {
    VectorXd theta(std::ssize(estimate.parameters));
    for (Index i = 0; i < theta.size(); ++i)
        theta[i] = estimate.parameters[static_cast<std::size_t>(i)].value;
    return theta;
}

/// Parameters that move by themselves, are determined, and have no prior beside which a tilt could stand.
std::vector<Index> movable(const std::vector<FreeParameter>& parameters, const EstimateOptions& options,
                           const Estimate& estimate) {
    const auto has_prior = [&](const FreeParameter& parameter) {
        return !std::holds_alternative<FlatPrior>(parameter.prior) ||
               std::any_of(options.joint_priors.begin(), options.joint_priors.end(), [&](const auto& joint) {
                   return std::find(joint.names.begin(), joint.names.end(), parameter.name) != joint.names.end();
               });
    };
    std::vector<Index> found;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const Estimated& one = estimate.parameters[i];
        if (parameters[i].tied_to.empty() && !is_held(parameters[i]) && !has_prior(parameters[i]) && one.sd > 0.0 &&
            one.laplace_sd > 0.0 && std::isfinite(one.sd) && one.at_bound == BoundSide::none)
            found.push_back(static_cast<Index>(i));
    }
    return found;
}

/// The parameter that one follows, or itself.
Index source_of(const std::vector<FreeParameter>& parameters, std::size_t i) {
    if (parameters[i].tied_to.empty()) return static_cast<Index>(i);
    return std::find_if(parameters.begin(), parameters.end(),
                        [&](const FreeParameter& one) { return one.name == parameters[i].tied_to; }) -
           parameters.begin();
}

SimulatedBias mean_of(const std::vector<VectorXd>& pairs, Index parameters) {
    SimulatedBias result;
    result.pairs = pairs.size();
    const auto count = static_cast<double>(pairs.size());
    result.value = VectorXd::Constant(parameters, pairs.empty() ? nan_value : 0.0);
    for (const VectorXd& one : pairs)
        result.value += one / count;
    result.error = VectorXd::Constant(parameters, pairs.size() < 2 ? nan_value : 0.0);
    if (pairs.size() < 2) return result;
    for (const VectorXd& one : pairs)
        result.error += (one - result.value).cwiseAbs2();
    result.error = (result.error / (count * (count - 1.0))).cwiseSqrt();
    return result;
}

}  // namespace

SimulatedBias simulated_bias(const std::vector<FreeParameter>& parameters,
                             const std::vector<const Residual*>& residuals, const EstimateOptions& options,
                             const Estimate& estimate, std::size_t pairs, const RecordDrawOptions& asked) {
    RecordDrawOptions more = asked;
    more.added = added_variance;
    const RecordDraws draws(residuals, estimate, more);
    const std::vector<DerivedQuantity> none;
    EstimateOptions rough = options;
    rough.step_tolerance = std::max(options.step_tolerance, rough_step);
    const Replication replication(parameters, residuals, none, rough, estimate, draws, asked.seed);
    const VectorXd theta = values_of(estimate);
    std::vector<VectorXd> means;
    const auto add = [&](std::size_t first, std::size_t last) {
        std::vector<BootstrapReplicate> replicates(2 * (last - first));
        const auto run = [&](std::size_t i) {
            if (options.interrupted && options.interrupted()) return;
            replicates[i] = replication.run(first + i / 2, i % 2 == 0 ? Mirror::none : Mirror::opposite);
        };
        if (is_long(estimate))
            for (std::size_t i = 0; i < replicates.size(); ++i)
                run(i);
        else
            tbb::parallel_for(std::size_t{0}, replicates.size(), run, tbb::simple_partitioner{});
        for (std::size_t i = 0; i < replicates.size(); i += 2) {
            const BootstrapReplicate &one = replicates[i], &other = replicates[i + 1];
            if (one.status == EstimateStatus::converged && other.status == EstimateStatus::converged)
                means.emplace_back((0.5 * (one.values + other.values).head(theta.size()) - theta) / added_variance);
        }
        return mean_of(means, theta.size());
    };
    SimulatedBias result = add(0, pairs);
    if (result.pairs == 0) result = add(pairs, (1 + second_try) * pairs);
    return result;
}

Estimate unbiased(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                  const std::vector<DerivedQuantity>& derived, const EstimateOptions& options, const Estimate& estimate,
                  std::size_t pairs, const RecordDrawOptions& draws) {
    constexpr int most_rounds = 5;
    if (estimate.status != EstimateStatus::converged) return estimate;
    std::vector<Index> which = movable(parameters, options, estimate);
    if (which.empty()) return estimate;
    const auto unchanged = [&](const std::string& why) {
        Estimate same = estimate;
        same.bias_left = why;
        same.message += "; the bias is not taken off: " + why;
        return same;
    };
    const auto stopped = [&] {
        Estimate half = estimate;
        half.status = EstimateStatus::interrupted;
        half.message = "interrupted before the bias was taken off";
        return half;
    };
    const SimulatedBias bias = simulated_bias(parameters, residuals, options, estimate, pairs, draws);
    if (options.interrupted && options.interrupted()) return stopped();
    if (bias.pairs == 0) return unchanged("no pair of records with further errors gave two estimates");
    for (const Index i : which) {
        const Estimated& one = estimate.parameters[static_cast<std::size_t>(i)];
        if (std::abs(bias.value[i]) > largest_bias * one.sd)
            return unchanged(fmt::format("that of {} is {:.2g} sds", one.name, bias.value[i] / one.sd));
    }
    std::erase_if(which, [&](Index i) {
        const FreeParameter& free = parameters[static_cast<std::size_t>(i)];
        const double to = estimate.parameters[static_cast<std::size_t>(i)].value - bias.value[i];
        return !(to > free.lower && to < free.upper);
    });
    if (which.empty()) return unchanged("all parameters would lie beyond their bounds");
    const models::CholeskyFactor information(estimate.laplace_covariance(which, which));
    if (!information.positive_definite()) return unchanged("the covariance of the parameters is singular");
    const VectorXd first = values_of(estimate)(which);
    VectorXd rest = bias.value(which);  // what the minimum still lies too high
    VectorXd slope = VectorXd::Constant(std::ssize(parameters), nan_value);
    slope(which).setZero();
    EstimateOptions quick = options;
    quick.verdict = false;
    quick.step_tolerance = std::max(options.step_tolerance, rough_step);
    Estimate now = estimate;
    Tilt tilt;
    double least = near_fold;
    std::optional<std::pair<Estimate, Tilt>> best;
    for (int round = 0; round < most_rounds && !(best && now.status != EstimateStatus::converged); ++round) {
        slope(which) += information.solve(rest);
        tilt = Tilt(parameters, now, slope);
        now = estimate_again(parameters, residuals, {}, tilt.with(quick), now);
        if (now.status == EstimateStatus::interrupted) return stopped();
        if (!(now.remaining < largest_bias)) return unchanged(now.message);
        rest = values_of(now)(which) - first + bias.value(which);
        double left = 0.0;
        for (Index k = 0; k < rest.size(); ++k)
            left = std::max(left,
                            std::abs(rest[k]) /
                                estimate.parameters[static_cast<std::size_t>(which[static_cast<std::size_t>(k)])].sd);
        if (!(left < largest_bias)) return unchanged("the estimate does not follow the slope");
        if (now.status == EstimateStatus::converged && left < least) {
            best.emplace(now, tilt);
            least = left;
        }
        if (least < near) break;
    }
    if (!best)
        return unchanged(now.status == EstimateStatus::converged ? "the estimate does not follow the slope"
                                                                 : now.message);
    std::tie(now, tilt) = *std::move(best);
    Estimate result = estimate_again(parameters, residuals, derived, tilt.with(options), now);
    if (result.status != EstimateStatus::converged)
        return result.status == EstimateStatus::interrupted ? stopped() : unchanged(result.message);
    tilt.take_out(parameters, result);
    result.tilt = tilt.prior();
    for (std::size_t i = 0; i < parameters.size(); ++i)
        if (std::find(which.begin(), which.end(), source_of(parameters, i)) != which.end())
            result.parameters[i].bias = estimate.parameters[i].value - result.parameters[i].value;
    return result;
}

}  // namespace orbid::estimator
