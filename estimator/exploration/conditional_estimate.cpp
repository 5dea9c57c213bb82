#include "estimator/exploration/conditional_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <stdexcept>

#include "estimator/interface/not_finite.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::estimator {

namespace {

const Estimated* find(const std::vector<Estimated>& list, const std::string& name) {
    const auto found = std::find_if(list.begin(), list.end(), [&](const Estimated& one) { return one.name == name; });
    return found == list.end() ? nullptr : &*found;
}

/// Values of all error parameters that an estimate shows.
std::vector<std::pair<std::string, double>> errors_of(const Estimate& estimate) {
    std::vector<std::pair<std::string, double>> values;
    for (const EstimatedScale& scale : estimate.scales) {
        values.emplace_back(scale.group + ".scale", scale.value);
        for (const Estimated& shape : scale.shape)
            values.emplace_back(scale.group + "." + shape.name, shape.value);
    }
    return values;
}

void check_belongs(const Estimate& estimate, std::size_t parameters, std::size_t residuals) {
    if (estimate.status == EstimateStatus::failed)
        throw std::invalid_argument("conditional estimates need an estimate that did not fail: " + estimate.message);
    if (estimate.parameters.size() != parameters)
        throw std::invalid_argument("the estimate has " + std::to_string(estimate.parameters.size()) + " parameters, " +
                                    std::to_string(parameters) + " are given");
    if (estimate.active.size() != residuals)
        throw std::invalid_argument("the estimate has " + std::to_string(estimate.active.size()) + " residuals, " +
                                    std::to_string(residuals) + " are given");
}

Unknown unknown_parameter(const FreeParameter& parameter, const Coordinate& coordinate, const Estimated& estimated) {
    Unknown unknown;
    unknown.name = parameter.name;
    unknown.unit = parameter.unit;
    unknown.value = estimated.value;
    unknown.u = coordinate.at(estimated.value);
    unknown.sd = estimated.laplace_sd / coordinate.slope(estimated.value);
    unknown.size = coordinate.size(estimated.value, parameter.typical_size);
    unknown.too_few_independent = estimated.interval_method == IntervalMethod::too_few_independent;
    if (estimated.sd > 0.0 && estimated.laplace_sd > 0.0) unknown.widening = estimated.sd / estimated.laplace_sd;
    unknown.degrees_of_freedom = estimated.interval_degrees_of_freedom;
    const Support ends = support(parameter.prior);
    unknown.natural_lower = std::max(parameter.lower, ends.lower);
    unknown.natural_upper = std::min(parameter.upper, ends.upper);
    const bool logarithmic = parameter.scale == Scale::log || parameter.scale == Scale::log10;
    if (logarithmic) unknown.natural_lower = std::max(unknown.natural_lower, 0.0);
    unknown.lower = coordinate.at(unknown.natural_lower);
    unknown.upper = coordinate.at(unknown.natural_upper);
    return unknown;
}

/// @param sd  natural; 0: held at a limit.
Unknown unknown_error(const Group& group, const ErrorCoordinate& coordinate, double value, double sd) {
    Unknown unknown;
    unknown.group = group.name;
    unknown.error = coordinate.name;
    unknown.name = unknown.group + "." + unknown.error;
    if (coordinate.name == "scale") unknown.unit = group.unit;
    unknown.value = value;
    unknown.u = coordinate.at(value);
    unknown.sd = sd > 0.0 ? sd / coordinate.slope(unknown.u) : nan_value;
    unknown.lower = coordinate.lower;
    unknown.upper = coordinate.upper;
    unknown.natural_lower = coordinate.natural(coordinate.lower);
    unknown.natural_upper = coordinate.natural(coordinate.upper);
    return unknown;
}

}  // namespace

Conditional::Conditional(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                         const EstimateOptions& options, const Estimate& estimate)
    : tied_(resolve_ties(parameters, residuals, options.joint_priors)), options_(options), active_(estimate.active) {
    check_belongs(estimate, parameters.size(), residuals.size());
    start_.latents = estimate.latents;
    start_.errors = errors_of(estimate);
    add_parameters(estimate);
    add_error_parameters(residuals, estimate);
}

void Conditional::add_parameters(const Estimate& estimate) {
    const auto count = static_cast<Eigen::Index>(tied_.parameters.size());
    start_.theta.resize(count);
    covariance_ = Eigen::MatrixXd::Zero(count, count);
    std::vector<Eigen::Index> place;
    Eigen::VectorXd slopes(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const FreeParameter& parameter = tied_.parameters[static_cast<std::size_t>(i)];
        const Estimated* value = find(estimate.parameters, parameter.name);
        if (value == nullptr) throw std::invalid_argument("the estimate has no parameter \"" + parameter.name + "\"");
        place.push_back(value - estimate.parameters.data());
        start_.theta[i] = value->value;
        coordinates_.push_back(coordinate_of(parameter));
        slopes[i] = coordinates_.back().slope(value->value);
        unknowns_.push_back(unknown_parameter(parameter, coordinates_.back(), *value));
        unknowns_.back().parameter = i;
        unknowns_.back().place = static_cast<std::size_t>(i);
    }
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < count; ++j) {
            const double c = estimate.covariance.size() > 0 ? estimate.covariance(place[i], place[j]) : nan_value;
            const double in_u = c / (slopes[i] * slopes[j]);
            if (std::isfinite(in_u)) covariance_(i, j) = in_u;
        }
}

void Conditional::add_error_parameters(const std::vector<const Residual*>& residuals, const Estimate& estimate) {
    std::vector<Group> groups;
    for (const ActiveSet& set : estimate.active)
        groups.insert(groups.end(), set.groups.begin(), set.groups.end());
    for (const NoiseModel& law : error_laws(residuals, estimate.active)) {
        if (law.joint()) continue;
        const Group& group = groups[static_cast<std::size_t>(law.channels.front())];
        const auto scale = std::find_if(estimate.scales.begin(), estimate.scales.end(),
                                        [&](const EstimatedScale& one) { return one.group == group.name; });
        if (scale == estimate.scales.end() || scale->count == 0) continue;
        for (const ErrorCoordinate& coordinate : law.coordinates) {
            if (!coordinate.estimate) continue;
            const bool is_scale = coordinate.name == "scale";
            const Estimated* shape = is_scale ? nullptr : find(scale->shape, coordinate.name);
            if (!is_scale && shape == nullptr) continue;
            unknowns_.push_back(unknown_error(group, coordinate, is_scale ? scale->value : shape->value,
                                              is_scale ? scale->uncertainty : shape->sd));
            unknowns_.back().place = unknowns_.size() - 1;
            error_coordinates_.push_back(coordinate);
        }
    }
}

std::vector<Unknown> Conditional::named(const std::vector<std::string>& names) const {
    if (names.empty()) return unknowns_;
    std::vector<Unknown> result;
    for (const std::string& name : names) {
        const auto found = std::find_if(unknowns_.begin(), unknowns_.end(),
                                        [&](const Unknown& unknown) { return unknown.name == name; });
        if (found == unknowns_.end())
            throw models::DataError("\"" + name +
                                    "\" is neither an estimated parameter nor an estimated error parameter");
        result.push_back(*found);
    }
    return result;
}

double Conditional::natural(const Unknown& unknown, double u) const {
    if (u == unknown.lower) return unknown.natural_lower;  // exactly, not through the coordinate and back
    if (u == unknown.upper) return unknown.natural_upper;
    if (unknown.parameter >= 0) return coordinates_[static_cast<std::size_t>(unknown.parameter)].natural(u);
    return error_coordinate(unknown).natural(u);
}

double Conditional::slope(const Unknown& unknown, double u) const {
    if (unknown.parameter >= 0)
        return coordinates_[static_cast<std::size_t>(unknown.parameter)].slope(natural(unknown, u));
    return error_coordinate(unknown).slope(u);
}

double Conditional::coordinate(const Unknown& unknown, double value) const {
    if (unknown.parameter >= 0) return coordinates_[static_cast<std::size_t>(unknown.parameter)].at(value);
    return error_coordinate(unknown).at(value);
}

double Conditional::log_prior(const Unknown& unknown, double u) const {
    const double x = natural(unknown, u);
    if (unknown.parameter < 0) {
        const Prior& prior = error_coordinate(unknown).prior;
        return is_proper(prior) ? std::log(slope(unknown, u)) - negative_log_density(prior, x) : 0.0;
    }
    for (const JointNormalPrior& joint : options_.joint_priors) {
        const auto found = std::find(joint.names.begin(), joint.names.end(), unknown.name);
        if (found == joint.names.end()) continue;
        const Eigen::Index k = found - joint.names.begin();
        return std::log(slope(unknown, u)) -
               negative_log_density(NormalPrior{joint.mean[k], std::sqrt(joint.covariance(k, k))}, x);
    }
    const auto i = static_cast<std::size_t>(unknown.parameter);
    return -coordinates_[i].term(tied_.parameters[i].prior, u).value;
}

ConditionalStart Conditional::moved(const ConditionalStart& from, const Unknown& unknown, double u) const {
    ConditionalStart start = from;
    if (unknown.parameter < 0) return start;  // nearly independent of the parameters
    const Eigen::Index j = unknown.parameter;
    const double variance = covariance_(j, j);
    const double step = u - coordinates_[static_cast<std::size_t>(j)].at(from.theta[j]);
    for (Eigen::Index i = 0; i < start.theta.size(); ++i) {
        const auto place = static_cast<std::size_t>(i);
        const Unknown& other = unknowns_[place];
        if (i == j || !(variance > 0.0) || !std::isfinite(step)) continue;
        const double here = coordinates_[place].at(from.theta[i]);
        double follow = here + covariance_(i, j) / variance * step;
        // Half way to a bound at most: on it the next minimisation would start without freedom.
        if (!(follow > other.lower)) follow = 0.5 * (here + std::max(other.lower, here - std::abs(follow - here)));
        if (!(follow < other.upper)) follow = 0.5 * (here + std::min(other.upper, here + std::abs(follow - here)));
        const double x = coordinates_[place].natural(follow);
        if (std::isfinite(x) && std::isfinite(negative_log_density(tied_.parameters[place].prior, x)))
            start.theta[i] = std::clamp(x, other.natural_lower, other.natural_upper);
    }
    start.theta[j] = natural(unknown, u);
    return start;
}

/// Joint priors given the value of one parameter: N(m_a + K (x - m_j), C_aa - K C_ja), K = C_aj / C_jj.
std::vector<JointNormalPrior> Conditional::joint_priors_without(const std::string& name, double value) const {
    std::vector<JointNormalPrior> result;
    for (const JointNormalPrior& joint : options_.joint_priors) {
        const auto found = std::find(joint.names.begin(), joint.names.end(), name);
        if (found == joint.names.end()) {
            result.push_back(joint);
            continue;
        }
        if (joint.names.size() == 1) continue;
        const Eigen::Index j = found - joint.names.begin();
        JointNormalPrior rest{joint.names, {}, {}};
        rest.names.erase(rest.names.begin() + j);
        std::vector<Eigen::Index> left(joint.names.size());
        std::iota(left.begin(), left.end(), Eigen::Index{0});
        left.erase(left.begin() + j);
        const Eigen::VectorXd gain = joint.covariance(left, j) / joint.covariance(j, j);
        rest.mean = joint.mean(left) + gain * (value - joint.mean[j]);
        const Eigen::MatrixXd covariance = joint.covariance(left, left) - gain * joint.covariance(j, left);
        rest.covariance = 0.5 * (covariance + covariance.transpose());
        result.push_back(std::move(rest));
    }
    return result;
}

/// Error parameters start where they were found; the one that is held is fixed at its value.
std::vector<ErrorOverride> Conditional::error_overrides(const ActiveSet& active, const Unknown* held, double value,
                                                        const ConditionalStart& from) const {
    std::vector<ErrorOverride> errors;
    for (const Group& group : active.groups)
        for (const Unknown& other : unknowns_) {
            if (other.parameter >= 0 || other.group != group.name) continue;
            const auto known = std::find_if(from.errors.begin(), from.errors.end(),
                                            [&](const auto& error) { return error.first == other.name; });
            if (held != nullptr && held->name == other.name)
                errors.push_back({other.group, other.error, value, false});
            else if (known != from.errors.end())
                errors.push_back({other.group, other.error, known->second, true});
        }
    return errors;
}

ConditionalEstimate Conditional::run(const Unknown* unknown, double u, const ConditionalStart& from, Variance variance,
                                     bool full_hessian) const {
    const Eigen::Index pinned = unknown != nullptr ? unknown->parameter : -1;
    const double value = unknown != nullptr ? natural(*unknown, u) : 0.0;
    EstimateOptions options = options_;
    options.variance = variance;
    options.full_hessian = full_hessian;
    options.verdict = false;
    options.maximum_rounds = 1;  // sets stay those of the estimate
    options.progress = nullptr;
    options.watched = nullptr;
    std::vector<FreeParameter> parameters;
    for (Eigen::Index i = 0; i < from.theta.size(); ++i) {
        if (i == pinned) continue;
        parameters.push_back(tied_.parameters[static_cast<std::size_t>(i)]);
        parameters.back().start = from.theta[i];
    }
    if (pinned >= 0) options.joint_priors = joint_priors_without(unknown->name, value);
    const ParameterMap map = pinned >= 0 ? ParameterMap::pinned(from.theta.size(), {{pinned, value}})
                                         : ParameterMap::identity(from.theta.size());
    std::vector<std::unique_ptr<MappedResidual>> adapters;
    std::vector<const Residual*> residuals;
    for (std::size_t r = 0; r < tied_.residuals.size(); ++r) {
        MappedResidualOptions change{error_overrides(active_[r], unknown, value, from), from.latents[r], active_[r]};
        adapters.push_back(std::make_unique<MappedResidual>(*tied_.residuals[r], map, std::move(change)));
        residuals.push_back(adapters.back().get());
    }
    const Estimate found = estimate(parameters, residuals, {}, options);
    ConditionalEstimate result;
    result.status = found.status;
    result.message = found.message;
    result.objective = found.objective;
    result.log_integral = found.log_integral;
    result.evaluations = found.evaluations;
    result.at = from;
    Eigen::Index k = 0;
    for (Eigen::Index i = 0; i < from.theta.size(); ++i)
        result.at.theta[i] = i == pinned ? value : found.parameters[static_cast<std::size_t>(k++)].value;
    if (found.status == EstimateStatus::failed) {
        result.objective = result.log_integral = nan_value;
        return result;
    }
    result.at.latents = found.latents;
    result.at.errors = errors_of(found);
    if (!std::isfinite(result.objective) || !std::isfinite(result.log_integral)) result.status = EstimateStatus::failed;
    return result;
}

}  // namespace orbid::estimator
