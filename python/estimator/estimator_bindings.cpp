#include <functional>
#include <limits>
#include <memory>
#include <utility>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

constexpr auto estimate_text = R"(Parameters, error scales and their uncertainties from residuals.

parameters  dict from names to start values, or to dicts as under "parameters" of a job: start, scale ("linear", "log",
            "log10", "logit"), bounds, prior, tied; also unit and typical_size. The order is that of theta.
residuals   a Residual or several.
derived     dict from names to pairs of functions of theta: value (a number), gradient (shape (parameters,)).
variance    "restricted", "ml" or "integrated": what error scales minimise (docs/estimator.md, section 3).
clusters    "automatic", "blocks" or "none"; maximum_iterations (200), maximum_rounds (20), step_tolerance (1e-6, in
            posterior sds), verdict (True), full_hessian (False), joint_priors (list as in a job).
progress    called as progress(iteration, objective) after every accepted step.

Ctrl-C: the best estimate so far, status "interrupted". An exception raised by a residual stops the estimate and is
raised here. ValueError, TypeError and KeyError name what is wrong.)";

std::vector<py::object> residual_list(py::handle residuals) {
    if (py::isinstance<estimator::Residual>(residuals)) return {py::reinterpret_borrow<py::object>(residuals)};
    if (!is_list(residuals)) throw py::type_error("residuals: needs a Residual or a list of them");
    std::vector<py::object> list;
    for (const py::handle one : residuals)
        list.push_back(py::reinterpret_borrow<py::object>(one));
    return list;
}

/// What a function of theta returns, nan where it failed. Not all need be finite: at the start it may have no value.
Eigen::VectorXd called(ResidualCall& call, py::handle function, const Eigen::VectorXd& theta, Eigen::Index size,
                       const std::string& where) {
    Eigen::VectorXd result = Eigen::VectorXd::Constant(size, std::numeric_limits<double>::quiet_NaN());
    call.attempt([&] {
        const Doubles numbers = doubles(function(array(Eigen::VectorXd(theta))), where.c_str());
        if (numbers.size() != size || numbers.ndim() > 1)
            throw py::value_error(where + ": shape " + std::string(py::str(numbers.attr("shape"))) + ", needs " +
                                  std::to_string(size) + (size == 1 ? " number" : " numbers"));
        result = vector(numbers);
    });
    return result;
}

std::shared_ptr<EstimateResult> estimate(py::handle parameters, py::handle residuals, py::handle derived,
                                         const py::kwargs& keywords) {
    auto result = std::make_shared<EstimateResult>();
    result->parameters = estimated_parameters(parameters);
    result->residuals = residual_list(residuals);
    result->derived = derived_functions(derived);
    ResidualCall call(result->residuals);
    NamedArguments given("estimate", keywords);
    const auto quantities = derived_quantities(result->derived, call);
    estimator::EstimateOptions options = estimate_options(given);
    if (const py::handle progress = progress_function(given))
        options.progress = [&call, progress](int iteration, double objective) {
            call.attempt([&] { progress(iteration, objective); });
        };
    given.finish();
    const bool interrupted = call.compute([&](const std::function<bool()>& stopped) {
        options.interrupted = stopped;
        result->estimate = estimator::estimate(result->parameters, call.residuals(), quantities, options);
    });
    // A signal that comes after the last step changes nothing.
    if (interrupted && result->estimate.status != estimator::EstimateStatus::interrupted)
        result->estimate.message += "; a signal to stop came after the last step";
    options.interrupted = nullptr;
    options.progress = nullptr;
    result->options = std::move(options);
    return result;
}

}  // namespace

std::vector<DerivedFunctions> derived_functions(py::handle derived) {
    std::vector<DerivedFunctions> functions;
    if (!derived || derived.is_none()) return functions;
    for (const auto& [key, value] : mapping(derived, "derived")) {
        const auto name = key.cast<std::string>();
        const std::string where = "derived '" + name + "'";
        if (!is_list(value) || py::len(value) != 2)
            throw py::type_error(where + ": needs a pair of functions (value, gradient)");
        DerivedFunctions one{name, value[py::int_(0)], value[py::int_(1)]};
        if (PyCallable_Check(one.value.ptr()) == 0 || PyCallable_Check(one.gradient.ptr()) == 0)
            throw py::type_error(where + ": needs functions");
        functions.push_back(std::move(one));
    }
    return functions;
}

std::vector<estimator::DerivedQuantity> derived_quantities(const std::vector<DerivedFunctions>& functions,
                                                           ResidualCall& call) {
    std::vector<estimator::DerivedQuantity> quantities;
    for (const DerivedFunctions& one : functions) {
        const std::string where = "derived '" + one.name + "'";
        estimator::DerivedQuantity quantity;
        quantity.name = one.name;
        // Borrowed: copies are made where the interpreter's lock is not held.
        quantity.value = [&call, where, function = one.value.ptr()](const Eigen::VectorXd& theta) {
            return called(call, function, theta, 1, where + ": value")[0];
        };
        quantity.gradient = [&call, where, function = one.gradient.ptr()](const Eigen::VectorXd& theta) {
            return called(call, function, theta, theta.size(), where + ": gradient");
        };
        quantities.push_back(std::move(quantity));
    }
    return quantities;
}

py::handle progress_function(NamedArguments& given) {
    const py::object progress = given.find_value("progress");
    if (progress && PyCallable_Check(progress.ptr()) == 0)
        throw py::type_error(given.place("progress") + ": needs a function");
    return progress.ptr();
}

estimator::Variance variance(NamedArguments& given) {
    using estimator::Variance;
    return given.word<Variance>(
        "variance", {{"restricted", Variance::restricted}, {"ml", Variance::ml}, {"integrated", Variance::integrated}},
        Variance::restricted);
}

estimator::EstimateOptions estimate_options(NamedArguments& given) {
    estimator::EstimateOptions options;
    using estimator::Clusters;
    options.variance = variance(given);
    options.clusters = given.word<Clusters>(
        "clusters", {{"automatic", Clusters::automatic}, {"blocks", Clusters::blocks}, {"none", Clusters::none}},
        options.clusters);
    given.take({{"maximum_iterations", options.maximum_iterations, 1},
                {"maximum_rounds", options.maximum_rounds, 1},
                {"step_tolerance", options.step_tolerance},
                {"relative_singular_value", options.relative_singular_value},
                {"verdict", options.verdict},
                {"full_hessian", options.full_hessian}});
    options.joint_priors = joint_priors(given);
    return options;
}

void bind_estimator(py::module_& module) {
    bind_residual(module);
    bind_series_residuals(module);
    bind_estimate_result(module);
    module.def("estimate", &estimate, py::arg("parameters"), py::arg("residuals"), py::arg("derived") = py::none(),
               estimate_text);
    bind_multi_start(module);
}

}  // namespace orbid::python
