#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_options.hpp"

namespace orbid::apps {

/// One field of all parameters.
[[nodiscard]] inline Eigen::VectorXd column(const std::vector<estimator::FreeParameter>& parameters,
                                            double estimator::FreeParameter::*field) {
    Eigen::VectorXd values(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
        values[static_cast<Eigen::Index>(i)] = parameters[i].*field;
    return values;
}

[[nodiscard]] inline Eigen::VectorXd starts(const std::vector<estimator::FreeParameter>& parameters) {
    return column(parameters, &estimator::FreeParameter::start);
}

}  // namespace orbid::apps
