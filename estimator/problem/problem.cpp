#include "estimator/problem/problem.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include <fmt/format.h>

#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

[[noreturn]] void refuse(const std::string& what) {
    throw std::invalid_argument(what);
}

void check_parameter(const FreeParameter& parameter) {
    const std::string who = "parameter \"" + parameter.name + "\": ";
    if (!std::isfinite(parameter.start)) refuse(who + "start = " + fmt::to_string(parameter.start) + " must be finite");
    if (!(parameter.lower < parameter.upper))
        refuse(who + "bounds [" + fmt::to_string(parameter.lower) + ", " + fmt::to_string(parameter.upper) +
               "]: the lower one must be below the upper one");
    if (!(parameter.start >= parameter.lower) || !(parameter.start <= parameter.upper))
        refuse(who + "start = " + fmt::to_string(parameter.start) + " lies outside its bounds [" +
               fmt::to_string(parameter.lower) + ", " + fmt::to_string(parameter.upper) + "]");
    if (!(parameter.typical_size > 0.0) || !std::isfinite(parameter.typical_size))
        refuse(who + "typical_size = " + fmt::to_string(parameter.typical_size) + " must be positive and finite");
    if ((parameter.scale == Scale::log || parameter.scale == Scale::log10) && !(parameter.start > 0.0))
        refuse(who + "start = " + fmt::to_string(parameter.start) +
               " must be positive on the log scale; use the linear scale to start at zero or below");
    if (parameter.scale == Scale::logit &&
        (!std::isfinite(parameter.lower) || !std::isfinite(parameter.upper) || !(parameter.start > parameter.lower) ||
         !(parameter.start < parameter.upper)))
        refuse(who + "the logit scale needs finite bounds and a start = " + fmt::to_string(parameter.start) +
               " between them");
    try {
        validate(parameter.prior);
    } catch (const std::invalid_argument& error) {
        refuse(who + error.what());
    }
    if (!std::isfinite(negative_log_density(parameter.prior, parameter.start)))
        refuse(who + "start = " + fmt::to_string(parameter.start) + " lies outside the support of its prior");
}

std::vector<Problem::Joint> joint_priors_of(const std::vector<FreeParameter>& parameters,
                                            const std::vector<JointNormalPrior>& priors) {
    std::vector<Problem::Joint> joints;
    for (const JointNormalPrior& prior : priors) {
        validate(prior);
        Problem::Joint joint{prior, {}};
        for (const std::string& name : prior.names) {
            const auto found = std::find_if(parameters.begin(), parameters.end(),
                                            [&name](const FreeParameter& parameter) { return parameter.name == name; });
            if (found == parameters.end()) refuse("joint prior: \"" + name + "\" is not an estimated parameter");
            if (!std::holds_alternative<FlatPrior>(found->prior))
                refuse("joint prior: \"" + name + "\" has a prior of its own as well");
            const auto place = static_cast<Eigen::Index>(found - parameters.begin());
            for (const Problem::Joint& other : joints)
                if (std::find(other.place.begin(), other.place.end(), place) != other.place.end())
                    refuse("joint prior: \"" + name + "\" is in two joint priors");
            joint.place.push_back(place);
        }
        joints.push_back(std::move(joint));
    }
    return joints;
}

}  // namespace

Problem set_up(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
               const std::vector<ActiveSet>& active, const std::vector<DerivedQuantity>& derived,
               const EstimateOptions& options) {
    if (options.maximum_iterations <= 0)
        refuse("maximum_iterations = " + std::to_string(options.maximum_iterations) + " must be positive");
    if (options.maximum_rounds <= 0)
        refuse("maximum_rounds = " + std::to_string(options.maximum_rounds) + " must be positive");
    if (!(options.step_tolerance > 0.0))
        refuse("step_tolerance = " + fmt::to_string(options.step_tolerance) + " must be positive");
    if (!(options.relative_singular_value > 0.0) || !(options.relative_singular_value < 1.0))
        refuse("relative_singular_value = " + fmt::to_string(options.relative_singular_value) +
               " must lie between 0 and 1");
    if (residuals.empty()) refuse("residuals: an estimate needs at least one");
    std::set<std::string> names;
    for (const FreeParameter& parameter : parameters) {
        if (!names.insert(parameter.name).second) refuse("parameter \"" + parameter.name + "\" is given twice");
        check_parameter(parameter);
    }
    for (const DerivedQuantity& quantity : derived) {
        if (!names.insert(quantity.name).second) refuse("derived quantity \"" + quantity.name + "\" is given twice");
        if (!quantity.value || !quantity.gradient)
            refuse("derived quantity \"" + quantity.name + "\" needs a value and a gradient");
    }
    Problem problem;
    problem.parameters = parameters;
    problem.residuals = residuals;
    problem.options = options;
    const auto count = static_cast<Eigen::Index>(parameters.size());
    problem.lower.resize(count);
    problem.upper.resize(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        FreeParameter& parameter = problem.parameters[static_cast<std::size_t>(i)];
        const Coordinate coordinate = coordinate_of(parameter);
        const Support reach = support(parameter.prior);
        parameter.lower = std::max(parameter.lower, reach.lower);
        parameter.upper = std::min(parameter.upper, reach.upper);
        if (!(parameter.lower < parameter.upper))
            refuse("parameter \"" + parameter.name + "\": its prior and its bounds exclude each other");
        // A log scale reaches down to zero, which it never attains.
        const bool logarithmic = parameter.scale == Scale::log || parameter.scale == Scale::log10;
        problem.lower[i] = coordinate.at(logarithmic ? std::max(parameter.lower, 0.0) : parameter.lower);
        problem.upper[i] = coordinate.at(parameter.upper);
        problem.coordinates.push_back(coordinate);
    }
    std::set<std::string> groups;
    for (const ActiveSet& set : active)
        for (const Group& group : set.groups)
            if (!groups.insert(group.name).second) refuse("group \"" + group.name + "\": the name is given twice");
    problem.channels = channels_of(residuals);
    problem.laws = error_laws(residuals, active);
    for (const NoiseModel& law : problem.laws)
        problem.errors.insert(problem.errors.end(), law.coordinates.begin(), law.coordinates.end());
    problem.joint_priors = joint_priors_of(parameters, options.joint_priors);
    return problem;
}

State initial_state(const Problem& problem, const std::vector<ActiveSet>& active) {
    State state;
    const auto count = static_cast<Eigen::Index>(problem.parameters.size());
    state.theta.resize(count);
    state.u.resize(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        state.theta[i] = problem.parameters[static_cast<std::size_t>(i)].start;
        state.u[i] = problem.coordinates[static_cast<std::size_t>(i)].at(state.theta[i]);
    }
    for (std::size_t r = 0; r < active.size(); ++r) {
        state.latents.push_back(active[r].latents);
        const auto& layout = active[r].layout;
        if (state.latents.back().size() != layout.size())
            refuse("residual \"" + std::string(problem.residuals[r]->type()) + "\": initial latent states of " +
                   std::to_string(state.latents.back().size()) + " blocks, layout has " +
                   std::to_string(layout.size()));
        for (std::size_t b = 0; b < layout.size(); ++b)
            if (state.latents.back()[b].size() != layout[b].latents)
                refuse("residual block \"" + layout[b].label + "\": " + std::to_string(state.latents.back()[b].size()) +
                       " initial latent states, layout says " + std::to_string(layout[b].latents));
    }
    state.psi.resize(static_cast<Eigen::Index>(problem.errors.size()));
    for (std::size_t k = 0; k < problem.errors.size(); ++k) {
        const ErrorCoordinate& coordinate = problem.errors[k];
        state.psi[static_cast<Eigen::Index>(k)] = coordinate.start_unknown() ? 0.0 : coordinate.at(coordinate.start);
    }
    return state;
}

const Group& group_of(const Problem& problem, int channel) {
    const Channel& place = problem.channels[static_cast<std::size_t>(channel)];
    return problem.residuals[place.residual]->groups()[static_cast<std::size_t>(place.group)];
}

void set_natural_parameters(const Problem& problem, const Eigen::VectorXd& u, Eigen::VectorXd& theta) {
    theta.resize(u.size());
    for (Eigen::Index i = 0; i < u.size(); ++i) {
        const auto index = static_cast<std::size_t>(i);
        theta[i] = std::clamp(problem.coordinates[index].natural(u[i]), problem.parameters[index].lower,
                              problem.parameters[index].upper);
    }
}

Eigen::VectorXd natural_parameters(const Problem& problem, const Eigen::VectorXd& u) {
    Eigen::VectorXd theta;
    set_natural_parameters(problem, u, theta);
    return theta;
}

PriorModel prior_at(const Problem& problem, const Eigen::VectorXd& u) {
    const Eigen::Index q = u.size();
    PriorModel model{0.0, Eigen::VectorXd::Zero(q), {}, Eigen::MatrixXd::Zero(q, q)};
    Eigen::VectorXd curvature(q);
    for (Eigen::Index i = 0; i < q; ++i) {
        const auto index = static_cast<std::size_t>(i);
        const PriorTerm term = problem.coordinates[index].term(problem.parameters[index].prior, u[i]);
        model.value += term.value;
        model.gradient[i] = term.gradient;
        model.second(i, i) = term.second;
        curvature[i] = term.curvature;
    }
    const Eigen::Index curved = (curvature.array() > 0.0).count();
    Eigen::Index row = 0;
    model.rows = Eigen::MatrixXd::Zero(curved, q);
    for (Eigen::Index i = 0; i < q; ++i)
        if (curvature[i] > 0.0) model.rows(row++, i) = std::sqrt(curvature[i]);
    for (const Problem::Joint& joint : problem.joint_priors) {
        const auto count = static_cast<Eigen::Index>(joint.place.size());
        std::vector<Coordinate> coordinates;
        for (const Eigen::Index place : joint.place)
            coordinates.push_back(problem.coordinates[static_cast<std::size_t>(place)]);
        const JointPriorTerm term = joint_term(joint.prior, coordinates, u(joint.place));
        model.value += term.value;
        const models::SymmetricEigen eigen = models::symmetric_eigen(term.curvature);
        const Eigen::MatrixXd root = eigen.values.cwiseMax(0.0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
        model.rows.conservativeResize(row + count, q);
        model.rows.bottomRows(count).setZero();
        model.rows.bottomRows(count)(Eigen::all, joint.place) = root;
        model.gradient(joint.place) += term.gradient;
        model.second(joint.place, joint.place) += term.second;
        row += count;
    }
    return model;
}

Eigen::VectorXd sizes(const Problem& problem, const Eigen::VectorXd& theta) {
    Eigen::VectorXd size(theta.size());
    for (Eigen::Index i = 0; i < theta.size(); ++i) {
        const auto index = static_cast<std::size_t>(i);
        size[i] = problem.coordinates[index].size(theta[i], problem.parameters[index].typical_size);
    }
    return size;
}

std::vector<bool> free_errors(const Problem& problem, const BlockSet& set) {
    std::vector<bool> free(problem.errors.size(), false);
    if (set.provisional) return free;
    for (const NoiseModel& law : problem.laws) {
        const bool data = std::all_of(law.channels.begin(), law.channels.end(),
                                      [&set](int channel) { return set.count[channel] > 0.0; });
        for (std::size_t j = 0; j < law.coordinates.size(); ++j)
            free[static_cast<std::size_t>(law.first) + j] = data && law.coordinates[j].estimate;
    }
    return free;
}

}  // namespace orbid::estimator
