#include "estimator/problem_setup.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

namespace orbid::estimator {

namespace {

std::string shown(double value) {
    std::ostringstream text;
    text.precision(17);
    text << value;
    return text.str();
}

[[noreturn]] void refuse(const std::string& what) {
    throw std::invalid_argument(what);
}

void check_parameter(const FreeParameter& parameter) {
    const std::string who = "parameter \"" + parameter.name + "\": ";
    if (!std::isfinite(parameter.start)) refuse(who + "start = " + shown(parameter.start) + " must be finite");
    if (!(parameter.lower < parameter.upper))
        refuse(who + "bounds [" + shown(parameter.lower) + ", " + shown(parameter.upper) +
               "]: the lower one must be below the upper one");
    if (!(parameter.start >= parameter.lower) || !(parameter.start <= parameter.upper))
        refuse(who + "start = " + shown(parameter.start) + " lies outside its bounds [" + shown(parameter.lower) +
               ", " + shown(parameter.upper) + "]");
    if (!(parameter.typical_size > 0.0) || !std::isfinite(parameter.typical_size))
        refuse(who + "typical_size = " + shown(parameter.typical_size) + " must be positive and finite");
    if (parameter.scale == Scale::log && !(parameter.start > 0.0))
        refuse(who + "start = " + shown(parameter.start) +
               " must be positive on the log scale; use the linear scale to start at zero or below");
    try {
        validate(parameter.prior);
    } catch (const std::invalid_argument& error) {
        refuse(who + error.what());
    }
    if (!std::isfinite(negative_log_density(parameter.prior, parameter.start)))
        refuse(who + "start = " + shown(parameter.start) + " lies outside the support of its prior");
}

}  // namespace

Problem set_up(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
               const std::vector<DerivedQuantity>& derived, const EstimateOptions& options) {
    if (options.maximum_iterations <= 0)
        refuse("maximum_iterations = " + std::to_string(options.maximum_iterations) + " must be positive");
    if (options.maximum_rounds <= 0)
        refuse("maximum_rounds = " + std::to_string(options.maximum_rounds) + " must be positive");
    if (!(options.step_tolerance > 0.0))
        refuse("step_tolerance = " + shown(options.step_tolerance) + " must be positive");
    if (!(options.relative_singular_value > 0.0) || !(options.relative_singular_value < 1.0))
        refuse("relative_singular_value = " + shown(options.relative_singular_value) + " must lie between 0 and 1");
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
        if (const auto* uniform = std::get_if<UniformPrior>(&parameter.prior)) {
            parameter.lower = std::max(parameter.lower, uniform->lower);
            parameter.upper = std::min(parameter.upper, uniform->upper);
        }
        const Coordinate coordinate{parameter.scale};
        // A log scale reaches down to zero, which it never attains.
        problem.lower[i] =
            coordinate.at(parameter.scale == Scale::log ? std::max(parameter.lower, 0.0) : parameter.lower);
        problem.upper[i] = coordinate.at(parameter.upper);
        problem.coordinates.push_back(coordinate);
    }
    std::set<std::string> groups;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        if (residuals[r] == nullptr) refuse("residuals[" + std::to_string(r) + "] is null");
        for (const Group& group : residuals[r]->groups()) {
            const std::string who = "group \"" + group.name + "\": ";
            if (!groups.insert(group.name).second) refuse(who + "the name is given twice");
            if (!group.scale.estimate && (!(group.scale.value > 0.0) || !std::isfinite(group.scale.value)))
                refuse(who + "fixed scale = " + shown(group.scale.value) + " must be positive and finite");
            if (std::isnan(group.scale.value)) refuse(who + "scale = nan");
            try {
                validate(group.scale.prior);
            } catch (const std::invalid_argument& error) {
                refuse(who + error.what());
            }
            problem.errors.push_back(group.scale);
        }
    }
    problem.channels = channels_of(residuals);
    return problem;
}

State initial_state(const Problem& problem) {
    State state;
    const auto count = static_cast<Eigen::Index>(problem.parameters.size());
    state.theta.resize(count);
    state.u.resize(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const auto index = static_cast<std::size_t>(i);
        state.theta[i] = problem.parameters[index].start;
        state.u[i] = problem.coordinates[index].at(state.theta[i]);
    }
    for (const Residual* residual : problem.residuals) {
        state.latents.push_back(residual->initial_latents());
        const auto& layout = residual->layout();
        if (state.latents.back().size() != layout.size())
            refuse("residual \"" + std::string(residual->type()) + "\": initial latent states of " +
                   std::to_string(state.latents.back().size()) + " blocks, layout has " +
                   std::to_string(layout.size()));
        for (std::size_t b = 0; b < layout.size(); ++b)
            if (state.latents.back()[b].size() != layout[b].latents)
                refuse("residual block \"" + layout[b].label + "\": " + std::to_string(state.latents.back()[b].size()) +
                       " initial latent states, layout says " + std::to_string(layout[b].latents));
    }
    state.ln_scale.resize(static_cast<Eigen::Index>(problem.errors.size()));
    for (std::size_t c = 0; c < problem.errors.size(); ++c)
        state.ln_scale[static_cast<Eigen::Index>(c)] =
            problem.errors[c].value > 0.0 ? std::log(problem.errors[c].value) : 0.0;
    return state;
}

}  // namespace orbid::estimator
