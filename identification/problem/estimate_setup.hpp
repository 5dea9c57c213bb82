#pragma once

#include <optional>
#include <string>
#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/residual.hpp"
#include "identification/problem/identification_problem.hpp"
#include "models/system/system.hpp"
#include "orbits/series_residuals/input_delay.hpp"

namespace orbid::identification {

/// The estimator's parameters, and their binding to every experiment.
struct EstimateSetup {
    std::vector<estimator::FreeParameter> parameters;
    std::vector<models::ParameterBinding> experiments;  ///< one per experiment
    models::ParameterBinding model;                     ///< of the model apart from any experiment (cycles from a file)
    std::vector<estimator::DerivedQuantity> derived;
    /// Initial values that are parameters: by experiment and coordinate, one index into `parameters` per fitted
    /// segment; empty for the others. Their start is nan where the problem gives none: it then comes from the data.
    std::vector<std::vector<std::vector<Eigen::Index>>> initial;

    [[nodiscard]] Eigen::VectorXd start() const;
    /// The delay of an experiment's inputs with the bounds of its estimate; of a value that is not estimated both are
    /// this value. Nothing where the inputs have none.
    [[nodiscard]] std::optional<orbits::InputDelay> delay(const Experiment& data, std::size_t experiment) const;
};

/// Parameters shared by all experiments come first, in the order of the problem, then those of single experiments,
/// named name@experiment, then initial values (see InitialValue::is_parameter). A parameter that every experiment has
/// of its own is not shared. Derived quantities use the shared parameters, and those of the first experiment where a
/// parameter is not shared.
///
/// @param segments  labels of the fitted segments of every experiment; empty for experiments that are not series.
[[nodiscard]] EstimateSetup estimate_setup(const IdentificationProblem& problem,
                                           const std::vector<std::vector<std::string>>& segments);

/// Full covariances of a residual that has one group per coordinate of `coordinates`, in that order.
[[nodiscard]] std::vector<estimator::JointCovariance> joint_covariances(const std::vector<JointErrors>& jobs,
                                                                        const std::vector<Eigen::Index>& coordinates);

}  // namespace orbid::identification
