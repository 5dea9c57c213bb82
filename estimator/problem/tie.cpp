#include "estimator/problem/tie.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

namespace orbid::estimator {

namespace {

void check(const FreeParameter& parameter, const std::map<std::string, const FreeParameter*>& by_name) {
    const auto refuse = [&](const std::string& what) {
        throw std::invalid_argument("parameter \"" + parameter.name + "\": " + what);
    };
    if (parameter.tied_to == parameter.name) refuse("is tied to itself");
    const auto target = by_name.find(parameter.tied_to);
    if (target == by_name.end()) refuse("is tied to \"" + parameter.tied_to + "\", which is not estimated");
    if (!target->second->tied_to.empty())
        refuse("is tied to \"" + parameter.tied_to + "\", which itself is tied to \"" + target->second->tied_to +
               "\": tie both to the same parameter");
    if (!std::isfinite(parameter.tie_factor) || parameter.tie_factor == 0.0)
        refuse("tie_factor = " + fmt::to_string(parameter.tie_factor) + " must be finite and not 0");
    if (!std::holds_alternative<FlatPrior>(parameter.prior))
        refuse("has a prior of its own although it is tied to \"" + parameter.tied_to + "\"; give the prior there");
}

/// The bounds of a follower, as bounds of the parameter it follows.
void take_bounds(const FreeParameter& follower, FreeParameter& leader) {
    double lower = follower.lower / follower.tie_factor;
    double upper = follower.upper / follower.tie_factor;
    if (follower.tie_factor < 0.0) std::swap(lower, upper);
    leader.lower = std::max(leader.lower, lower);
    leader.upper = std::min(leader.upper, upper);
    if (!(leader.lower < leader.upper))
        throw std::invalid_argument("parameter \"" + follower.name + "\": its bounds leave \"" + leader.name +
                                    "\", to which it is tied, no room");
}

Estimated follow(const Estimated& leader, const FreeParameter& parameter, double factor) {
    Estimated result = leader;
    result.name = parameter.name;
    result.unit = parameter.unit;
    result.value *= factor;
    result.start *= factor;
    result.sd *= std::abs(factor);
    result.laplace_sd *= std::abs(factor);
    result.lower95 *= factor;
    result.upper95 *= factor;
    if (factor < 0.0) {
        std::swap(result.lower95, result.upper95);
        if (result.at_bound != BoundSide::none)
            result.at_bound = result.at_bound == BoundSide::lower ? BoundSide::upper : BoundSide::lower;
    }
    return result;
}

/// What is said of a parameter that keeps its value.
Estimated held_at(const FreeParameter& parameter, double value) {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    Estimated result;
    result.name = parameter.name;
    result.unit = parameter.unit;
    result.value = result.start = value;
    result.sd = result.laplace_sd = result.lower95 = result.upper95 = unknown;
    result.interval_method = IntervalMethod::fixed;
    result.data_share = 0.0;
    return result;
}

}  // namespace

bool is_held(const FreeParameter& parameter) {
    return parameter.tied_to.empty() && parameter.lower == parameter.upper && parameter.start == parameter.lower;
}

bool any_tied(const std::vector<FreeParameter>& parameters) {
    return std::any_of(parameters.begin(), parameters.end(),
                       [](const FreeParameter& parameter) { return !parameter.tied_to.empty() || is_held(parameter); });
}

TiedProblem resolve_ties(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                         const std::vector<JointNormalPrior>& joint_priors) {
    std::map<std::string, const FreeParameter*> by_name;
    for (const FreeParameter& parameter : parameters)
        if (!by_name.emplace(parameter.name, &parameter).second)
            throw std::invalid_argument("parameter \"" + parameter.name + "\" is given twice");
    TiedProblem problem;
    problem.full = parameters;
    std::map<std::string, Eigen::Index> reduced;
    for (const FreeParameter& parameter : parameters) {
        if (!parameter.tied_to.empty()) {
            check(parameter, by_name);
            continue;
        }
        if (is_held(parameter)) continue;
        reduced[parameter.name] = static_cast<Eigen::Index>(problem.parameters.size());
        problem.parameters.push_back(parameter);
    }
    for (const JointNormalPrior& prior : joint_priors)
        for (const std::string& name : prior.names)
            if (const auto found = by_name.find(name); found != by_name.end() && !found->second->tied_to.empty())
                throw std::invalid_argument("parameter \"" + name +
                                            "\": is in a joint prior although it is tied to \"" +
                                            found->second->tied_to + "\"; name that one there");
    std::vector<ParameterSource> sources;
    for (const FreeParameter& parameter : parameters) {
        if (is_held(parameter)) {
            sources.push_back({-1, parameter.start});
            continue;
        }
        if (parameter.tied_to.empty()) {
            sources.push_back({reduced.at(parameter.name), 1.0});
            continue;
        }
        if (const FreeParameter& held = *by_name.at(parameter.tied_to); is_held(held)) {
            sources.push_back({-1, parameter.tie_factor * held.start});
            continue;
        }
        const Eigen::Index leader = reduced.at(parameter.tied_to);
        take_bounds(parameter, problem.parameters[static_cast<std::size_t>(leader)]);
        sources.push_back({leader, parameter.tie_factor});
    }
    problem.map = ParameterMap(std::move(sources), static_cast<Eigen::Index>(problem.parameters.size()));
    if (!problem.any()) {
        problem.residuals = residuals;
        return problem;
    }
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        if (residuals[r] == nullptr) throw std::invalid_argument("residuals[" + std::to_string(r) + "] is null");
        problem.adapters.push_back(std::make_unique<MappedResidual>(*residuals[r], problem.map));
        problem.residuals.push_back(problem.adapters.back().get());
    }
    return problem;
}

std::vector<DerivedQuantity> TiedProblem::derived(const std::vector<DerivedQuantity>& quantities) const {
    if (!any()) return quantities;
    std::vector<DerivedQuantity> result;
    for (const DerivedQuantity& quantity : quantities) {
        DerivedQuantity reduced{quantity.name, {}, {}};
        if (quantity.value)
            reduced.value = [value = quantity.value, at = map](const Eigen::VectorXd& theta) {
                return value(at.expand(theta));
            };
        if (quantity.gradient)
            reduced.gradient = [gradient = quantity.gradient, at = map](const Eigen::VectorXd& theta) {
                return Eigen::VectorXd(at.reduce_columns(gradient(at.expand(theta)).transpose()).transpose());
            };
        result.push_back(std::move(reduced));
    }
    return result;
}

void TiedProblem::expand(Estimate& estimate) const {
    if (!any()) return;
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    const auto& sources = map.sources();
    const auto n = map.full_size();
    const std::vector<Estimated> reduced = std::move(estimate.parameters);
    estimate.parameters.clear();
    for (std::size_t i = 0; i < full.size(); ++i) {
        const ParameterSource& source = sources[i];
        estimate.parameters.push_back(
            source.reduced < 0 ? held_at(full[i], source.value)
                               : follow(reduced[static_cast<std::size_t>(source.reduced)], full[i], source.value));
    }
    const auto rows = [&](const Eigen::VectorXd& values, double held) {
        Eigen::VectorXd all(n);
        for (Eigen::Index i = 0; i < n; ++i) {
            const Eigen::Index from = sources[static_cast<std::size_t>(i)].reduced;
            all[i] = from < 0 ? held : values[from];
        }
        return all;
    };
    // Element by element: undetermined rows are nan, which a matrix product would spread.
    const auto square = [&](const Eigen::MatrixXd& values, bool signs) {
        Eigen::MatrixXd all = Eigen::MatrixXd::Constant(n, n, unknown);
        const auto factor = [&](const ParameterSource& one) {
            return signs ? std::copysign(1.0, one.value) : one.value;
        };
        for (Eigen::Index i = 0; i < n; ++i)
            for (Eigen::Index j = 0; j < n; ++j) {
                const ParameterSource &a = sources[static_cast<std::size_t>(i)],
                                      &b = sources[static_cast<std::size_t>(j)];
                if (a.reduced < 0 || b.reduced < 0) continue;
                all(i, j) = factor(a) * factor(b) * values(a.reduced, b.reduced);
            }
        return all;
    };
    const Eigen::Index count = map.reduced_size();
    if (estimate.covariance.rows() == count) estimate.covariance = square(estimate.covariance, false);
    if (estimate.laplace_covariance.rows() == count)
        estimate.laplace_covariance = square(estimate.laplace_covariance, false);
    if (estimate.correlation.rows() == count) estimate.correlation = square(estimate.correlation, true);
    if (estimate.hessian_ratio.size() == count) estimate.hessian_ratio = rows(estimate.hessian_ratio, unknown);
    // Relative changes: a follower changes by the same fraction as the parameter it follows.
    for (NullDirection& direction : estimate.null_directions)
        if (direction.components.size() == count) direction.components = rows(direction.components, 0.0);
    // A product of powers is named by the parameters that are free: with followers it would be another product.
    for (SloppyDirection& direction : estimate.sloppy_directions) {
        if (direction.components.size() != count) continue;
        Eigen::VectorXd components = rows(direction.components, 0.0);
        for (std::size_t i = 0; i < full.size(); ++i)
            if (!full[i].tied_to.empty()) components[static_cast<Eigen::Index>(i)] = 0.0;
        direction.components = components;
    }
}

Estimate TiedProblem::reduced(const Estimate& estimate) const {
    Estimate part = estimate;
    part.parameters.clear();
    std::vector<Eigen::Index> places;
    for (std::size_t i = 0; i < full.size() && i < estimate.parameters.size(); ++i) {
        if (!full[i].tied_to.empty() || map.sources()[i].reduced < 0) continue;
        places.push_back(static_cast<Eigen::Index>(i));
        part.parameters.push_back(estimate.parameters[i]);
    }
    const Eigen::Index count = map.full_size();
    if (part.covariance.rows() == count) part.covariance = estimate.covariance(places, places);
    if (part.correlation.rows() == count) part.correlation = estimate.correlation(places, places);
    if (part.hessian_ratio.size() == count) part.hessian_ratio = estimate.hessian_ratio(places);
    for (NullDirection& direction : part.null_directions)
        if (direction.components.size() == count) direction.components = Eigen::VectorXd(direction.components(places));
    for (SloppyDirection& direction : part.sloppy_directions)
        if (direction.components.size() == count) direction.components = Eigen::VectorXd(direction.components(places));
    return part;
}

}  // namespace orbid::estimator
