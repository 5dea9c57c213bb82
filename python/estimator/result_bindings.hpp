#pragma once

#include <memory>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "estimator/estimate/estimate.hpp"

namespace orbid::python {

class ResidualCall;

/// A quantity of theta computed by two functions in Python.
struct DerivedFunctions {
    std::string name;
    pybind11::object value, gradient;
};

/// Input and outcome of an estimate; profiles, marginals and samples are its methods.
struct EstimateResult {
    std::vector<estimator::FreeParameter> parameters;
    std::vector<pybind11::object> residuals;  ///< kept alive
    std::vector<DerivedFunctions> derived;    ///< unaffected by later changes of the caller's mapping
    estimator::EstimateOptions options;
    estimator::Estimate estimate;
};

/// Options of estimate() as keyword arguments, but for `progress`.
class NamedArguments;
[[nodiscard]] estimator::EstimateOptions estimate_options(NamedArguments& given);
/// "variance" among them.
[[nodiscard]] estimator::Variance variance(NamedArguments& given);
/// `progress`, which the keyword arguments keep; empty: none. @throws TypeError
[[nodiscard]] pybind11::handle progress_function(NamedArguments& given);

/// Functions written in Python, {"name": (value, gradient)}; None: none.
/// @throws TypeError for anything but a mapping from texts to pairs of functions.
[[nodiscard]] std::vector<DerivedFunctions> derived_functions(pybind11::handle derived);

/// The same as the estimator calls them, through `call`; valid as long as both.
[[nodiscard]] std::vector<estimator::DerivedQuantity> derived_quantities(const std::vector<DerivedFunctions>& functions,
                                                                         ResidualCall& call);

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
