#pragma once

#include <memory>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "estimator/estimate.hpp"

namespace orbid::python {

class ResidualCall;

/// What was asked for and what came out; profiles, marginals and samples are asked of it.
struct EstimateResult {
    std::vector<estimator::FreeParameter> parameters;
    std::vector<pybind11::object> residuals;  ///< kept alive
    pybind11::object derived;                 ///< None, or a mapping from names to (value, gradient)
    estimator::EstimateOptions options;
    estimator::Estimate estimate;
};

/// Options of estimate() as keyword arguments; `progress` is called through `call`.
class NamedArguments;
[[nodiscard]] estimator::EstimateOptions estimate_options(NamedArguments& given, ResidualCall& call);

/// Quantities written in Python, {"name": (value, gradient)}, called through `call`.
[[nodiscard]] std::vector<estimator::DerivedQuantity> derived_quantities(pybind11::handle derived, ResidualCall& call);

/// Everything as dicts, lists, numbers and texts.
[[nodiscard]] pybind11::dict estimate_dict(const estimator::Estimate& estimate);

/// Classes Estimated, EstimatedScale and Estimate.
void bind_estimate_result(pybind11::module_& module);
/// Profile likelihood, marginals, draws from the posterior: methods of Estimate.
void bind_estimate_inquiry(pybind11::class_<EstimateResult, std::shared_ptr<EstimateResult>>& result);
/// Class Residual.
void bind_residual(pybind11::module_& module);
/// multi_start().
void bind_multi_start(pybind11::module_& module);

}  // namespace orbid::python
