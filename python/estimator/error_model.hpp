#pragma once

#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "estimator/estimate/estimate.hpp"

namespace orbid::python {

class NamedArguments;

/// A prior as in a job: None or "flat", {"normal": {"mean": 0, "sd": 1}}, {"lognormal": {"median": .., "log_sd": ..}},
/// "uniform", "half_normal", "half_cauchy", "gamma", "student_t".
/// @throws TypeError, ValueError naming `where` and what is wrong.
[[nodiscard]] estimator::Prior prior(pybind11::handle description, const std::string& where);

/// {"normal": {"names": [..], "mean": [..], "covariance": [[..]]}} as in a job.
[[nodiscard]] estimator::JointNormalPrior joint_prior(pybind11::handle description, const std::string& where);

/// Scale, distribution and floor of errors as in a job: keys distribution, dof, relative, correlation, sd, floor.
struct ErrorModel {
    estimator::ErrorScale scale;
    estimator::ErrorDistribution distribution;
    double floor = 0.0;
};
/// Takes its keys from `description`; the caller finishes it. A scale without "sd" is estimated, starting from the
/// residuals.
[[nodiscard]] ErrorModel error_model(NamedArguments& description, const std::string& where);

/// One error model for each coordinate: a mapping from names to descriptions; others are normal with an estimated sd.
/// @throws KeyError for a name not in `names`.
[[nodiscard]] std::vector<ErrorModel> error_models(pybind11::handle descriptions, const std::vector<std::string>& names,
                                                   const std::string& where);

/// {"name": "phi", "unit": "rad", ...} with the keys of an error model, "factor", "interval" and "interval_unit".
[[nodiscard]] estimator::Group group(pybind11::handle description, std::size_t number);

/// Parameters of an estimate: a mapping from names to start values or to dicts as under "parameters" of a job (start,
/// scale, bounds, prior, tied) with "unit" and "typical_size".
[[nodiscard]] std::vector<estimator::FreeParameter> estimated_parameters(pybind11::handle parameters);

/// The same for one parameter, where `usual` has its name and what is not given. @param known  its start as well.
[[nodiscard]] estimator::FreeParameter free_parameter(estimator::FreeParameter usual, pybind11::handle description,
                                                      bool known);
/// "bounds": [lower, upper], None where there is none. @return whether they are given.
bool read_bounds(NamedArguments& given, const std::string& where, double& lower, double& upper);

/// "joint_priors": a list of them, empty unless given.
[[nodiscard]] std::vector<estimator::JointNormalPrior> joint_priors(NamedArguments& given);

/// A number that is fixed, "estimate", or {"estimate": {"start": .., "prior": ..}}.
[[nodiscard]] estimator::ErrorParameter error_parameter(pybind11::handle value, double start, const std::string& where);

}  // namespace orbid::python
