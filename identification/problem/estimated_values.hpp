#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/estimate_result.hpp"

namespace orbid::identification {

/// One field of all parameters, of those that are free or of those of an estimate.
template <class Parameter>
[[nodiscard]] Eigen::VectorXd column(const std::vector<Parameter>& parameters, double Parameter::*field) {
    Eigen::VectorXd values(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
        values[static_cast<Eigen::Index>(i)] = parameters[i].*field;
    return values;
}

[[nodiscard]] inline Eigen::VectorXd starts(const std::vector<estimator::FreeParameter>& parameters) {
    return column(parameters, &estimator::FreeParameter::start);
}

/// Values of an estimate, as the estimator's vector.
[[nodiscard]] inline Eigen::VectorXd estimated_theta(const estimator::Estimate& estimate) {
    return column(estimate.parameters, &estimator::Estimated::value);
}

/// Whether one of the priors of several parameters names this one.
[[nodiscard]] inline bool in_joint_prior(const std::vector<estimator::JointNormalPrior>& priors,
                                         const std::string& name) {
    return std::any_of(priors.begin(), priors.end(), [&](const estimator::JointNormalPrior& prior) {
        return std::find(prior.names.begin(), prior.names.end(), name) != prior.names.end();
    });
}

/// Scale of a group; null when the estimate has none.
[[nodiscard]] inline const estimator::EstimatedScale* scale_of(const estimator::Estimate& estimate,
                                                               const std::string& group) {
    for (const auto& scale : estimate.scales)
        if (scale.group == group) return &scale;
    return nullptr;
}

}  // namespace orbid::identification
