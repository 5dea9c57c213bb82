#include "identification/problem/estimate_setup.hpp"

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"

namespace orbid::identification {

namespace {

/// What the parameter that another one follows is called in an experiment.
std::string name_in(const IdentificationProblem& problem, const Experiment& data, const std::string& name) {
    for (const FreeModelParameter& free : problem.parameters)
        if (free.value.name == name && data.has_own(free.parameter)) return fmt::format("{}@{}", name, data.name);
    return name;
}

/// All experiments have it for themselves: nothing is left to share.
bool is_shared(const IdentificationProblem& problem, Eigen::Index parameter) {
    return problem.experiments.empty() || !std::all_of(problem.experiments.begin(), problem.experiments.end(),
                                                       [&](const Experiment& data) { return data.has_own(parameter); });
}

void bind(models::ParameterBinding& binding, Eigen::Index parameter, std::size_t estimated) {
    binding.parameter.push_back(parameter);
    binding.estimated.push_back(static_cast<Eigen::Index>(estimated));
}

void add_initial_values(const IdentificationProblem& problem, std::size_t experiment,
                        const std::vector<std::string>& segments, EstimateSetup& setup) {
    const Experiment& data = problem.experiments[experiment];
    auto& indices = setup.initial[experiment];
    indices.resize(data.initial_state.size());
    for (std::size_t i = 0; i < data.initial_state.size(); ++i) {
        const InitialValue& initial = data.initial_state[i];
        if (!initial.is_parameter()) continue;
        const models::Coordinate& coordinate = problem.system->coordinates()[i];
        for (const std::string& segment : segments) {
            estimator::FreeParameter parameter;
            parameter.name = initial_parameter_name(std::string(coordinate.name), data.name);
            if (segments.size() > 1) parameter.name += "." + segment;
            parameter.unit = coordinate.unit;
            parameter.start = initial.value.value_or(std::numeric_limits<double>::quiet_NaN());
            parameter.scale = initial.scale;
            parameter.lower = initial.lower;
            parameter.upper = initial.upper;
            parameter.prior = initial.prior;
            indices[i].push_back(static_cast<Eigen::Index>(setup.parameters.size()));
            setup.parameters.push_back(std::move(parameter));
        }
    }
}

estimator::DerivedQuantity derived_quantity(const ModelQuantity& derived, const models::ParameterBinding& binding) {
    const models::Expression expression = derived.expression;
    return {derived.name,
            [expression, binding](const Eigen::VectorXd& theta) { return expression.value(binding.values(theta)); },
            [expression, binding](const Eigen::VectorXd& theta) {
                const Eigen::VectorXd gradient = expression.gradient(binding.values(theta));
                Eigen::MatrixXd columns(1, static_cast<Eigen::Index>(binding.parameter.size()));
                for (std::size_t i = 0; i < binding.parameter.size(); ++i)
                    columns(0, static_cast<Eigen::Index>(i)) = gradient[binding.parameter[i]];
                return Eigen::VectorXd(binding.spread(columns).transpose());
            }};
}

}  // namespace

std::vector<estimator::JointCovariance> joint_covariances(const std::vector<JointErrors>& jobs,
                                                          const std::vector<Eigen::Index>& coordinates) {
    std::vector<estimator::JointCovariance> covariances;
    for (const JointErrors& job : jobs) {
        estimator::JointCovariance& covariance = covariances.emplace_back();
        for (const Eigen::Index coordinate : job.coordinates) {
            const auto at = std::find(coordinates.begin(), coordinates.end(), coordinate);
            covariance.groups.push_back(static_cast<int>(at - coordinates.begin()));
        }
        covariance.dof = job.dof;
        covariance.psi = job.psi;
    }
    return covariances;
}

Eigen::VectorXd EstimateSetup::start() const {
    return starts(parameters);
}

std::optional<orbits::InputDelay> EstimateSetup::delay(const Experiment& data, std::size_t experiment) const {
    if (!data.delay) return std::nullopt;
    const models::ParameterBinding& binding = experiments[experiment];
    const double value = binding.base[*data.delay];
    orbits::InputDelay delay{*data.delay, value, value};
    for (std::size_t j = 0; j < binding.parameter.size(); ++j) {
        if (binding.parameter[j] != *data.delay) continue;
        const estimator::FreeParameter& free = parameters[static_cast<std::size_t>(binding.estimated[j])];
        delay.lower = free.lower;
        delay.upper = free.upper;
    }
    return delay;
}

EstimateSetup estimate_setup(const IdentificationProblem& problem,
                             const std::vector<std::vector<std::string>>& segments) {
    EstimateSetup setup;
    setup.model.base = problem.values;
    setup.experiments.resize(problem.experiments.size());
    // A simulated experiment's own values made its data; what is estimated there starts elsewhere.
    for (std::size_t e = 0; e < problem.experiments.size(); ++e)
        setup.experiments[e].base = problem.experiments[e].with_own(problem.values);
    for (const FreeModelParameter& free : problem.parameters) {
        if (!is_shared(problem, free.parameter)) continue;
        bind(setup.model, free.parameter, setup.parameters.size());
        for (std::size_t e = 0; e < problem.experiments.size(); ++e)
            if (!problem.experiments[e].has_own(free.parameter))
                bind(setup.experiments[e], free.parameter, setup.parameters.size());
        setup.parameters.push_back(free.value);
    }
    for (std::size_t e = 0; e < problem.experiments.size(); ++e) {
        for (const FreeModelParameter& free : problem.parameters) {
            if (!problem.experiments[e].has_own(free.parameter)) continue;
            bind(setup.experiments[e], free.parameter, setup.parameters.size());
            if (e == 0 && !is_shared(problem, free.parameter))
                bind(setup.model, free.parameter, setup.parameters.size());
            setup.parameters.push_back(free.value);
            setup.parameters.back().name = fmt::format("{}@{}", free.value.name, problem.experiments[e].name);
            setup.parameters.back().tied_to = name_in(problem, problem.experiments[e], free.value.tied_to);
        }
    }
    setup.initial.resize(problem.experiments.size());
    if (problem.series) {
        for (const std::size_t experiment : problem.series->data)
            add_initial_values(problem, experiment, segments[experiment], setup);
    }
    const auto count = static_cast<Eigen::Index>(setup.parameters.size());
    setup.model.estimated_count = count;
    for (models::ParameterBinding& binding : setup.experiments)
        binding.estimated_count = count;
    for (const ModelQuantity& derived : problem.derived)
        setup.derived.push_back(derived_quantity(derived, setup.model));
    return setup;
}

}  // namespace orbid::identification
