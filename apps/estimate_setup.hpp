#pragma once

#include <vector>

#include "apps/job.hpp"
#include "estimator/estimate.hpp"
#include "models/system.hpp"

namespace orbid::apps {

/// The estimator's parameters, and how every experiment sees them.
struct EstimateSetup {
    std::vector<estimator::FreeParameter> parameters;
    std::vector<models::ParameterBinding> experiments;  ///< one per Job::data
    models::ParameterBinding model;                     ///< of the model apart from any experiment (cycles from a file)
    std::vector<estimator::DerivedQuantity> derived;

    [[nodiscard]] Eigen::VectorXd start() const;
};

/// Parameters shared by all experiments come first, in the order of the job, then those of single experiments, named
/// name@experiment. A parameter that every experiment has for itself is not shared. Derived quantities are formed from
/// the shared parameters, or from those of the first experiment where a parameter is not shared.
[[nodiscard]] EstimateSetup estimate_setup(const Job& job);

}  // namespace orbid::apps
