#include "estimator/exploration/multi_start.hpp"

#include <utility>

#include <pybind11/stl.h>

#include "estimator/interface/mapped_residual.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

/// Residuals that a function in Python makes anew for a run. They are wrapped, as the run owns what it gets; the call
/// keeps them alive.
std::vector<std::unique_ptr<estimator::Residual>> fresh_residuals(ResidualCall& call, py::handle factory,
                                                                  Eigen::Index parameters) {
    std::vector<std::unique_ptr<estimator::Residual>> wrapped;
    const py::gil_scoped_acquire lock;
    try {
        py::object made = factory();
        if (py::isinstance<estimator::Residual>(made)) made = py::make_tuple(made);
        for (const py::handle one : made) {
            call.add(one);
            wrapped.push_back(std::make_unique<estimator::MappedResidual>(
                *call.residuals().back(), estimator::ParameterMap::identity(parameters)));
        }
    } catch (...) {
        call.fail(std::current_exception());
        throw std::runtime_error("the function that makes residuals failed");
    }
    return wrapped;
}

py::dict run_dict(const estimator::StartedRun& run) {
    return py::dict("start"_a = run.start, "from"_a = array(Eigen::VectorXd(run.from)),
                    "theta"_a = array(Eigen::VectorXd(run.theta)), "status"_a = std::string(name(run.status)),
                    "message"_a = run.message, "objective"_a = run.objective, "records"_a = run.records,
                    "evaluations"_a = run.evaluations, "optimum"_a = run.optimum, "screened"_a = run.screened);
}

py::dict optimum_dict(const estimator::Optimum& optimum) {
    return py::dict("objective"_a = optimum.objective, "theta"_a = array(Eigen::VectorXd(optimum.theta)),
                    "starts"_a = optimum.starts);
}

py::dict multi_start(py::handle parameters, py::object residuals, py::handle derived, const py::kwargs& keywords) {
    auto best = std::make_shared<EstimateResult>();
    best->parameters = estimated_parameters(parameters);
    best->derived = derived_functions(derived);
    if (PyCallable_Check(residuals.ptr()) == 0)
        throw py::type_error("residuals: needs a function that returns fresh residuals at each call");
    ResidualCall call;
    NamedArguments given("multi_start", keywords);
    const auto quantities = derived_quantities(best->derived, call);
    estimator::MultiStartOptions options;
    given.take({{"starts", options.starts, 1},
                {"seed", options.seed},
                {"width", options.width},
                {"screening_iterations", options.screening_iterations},
                {"kept", options.kept, 1},
                {"distance", options.distance},
                {"objective_tolerance", options.objective_tolerance}});
    options.estimate = estimate_options(given);
    if (const py::handle progress = progress_function(given))
        options.progress = [&call, progress](int finished, int total) {
            call.attempt([&] { progress(finished, total); });
        };
    given.finish();
    estimator::MultiStart found;
    (void)call.compute([&](const std::function<bool()>& stopped) {
        options.estimate.interrupted = stopped;
        found = estimator::multi_start(
            best->parameters, [&] { return fresh_residuals(call, residuals, std::ssize(best->parameters)); },
            quantities, options);
    });
    best->estimate = std::move(found.best);
    return py::dict("best"_a = best, "best_start"_a = found.best_start, "optima"_a = listed(found.optima, optimum_dict),
                    "runs"_a = listed(found.runs, run_dict), "interrupted"_a = found.interrupted);
}

}  // namespace

void bind_multi_start(py::module_& module) {
    module.def(
        "multi_start", &multi_start, py::arg("parameters"), py::arg("residuals"), py::arg("derived") = py::none(),
        "estimate() from several starts, the given one and random ones: best, best_start, optima, runs,\n"
        "interrupted.\n\n"
        "residuals: a function without arguments that returns fresh residuals at each call, which share nothing\n"
        "that changes. starts (20), seed (1), width, screening_iterations, kept, distance, objective_tolerance,\n"
        "and the options of estimate(); progress is called as progress(finished, total) after every run.");
}

}  // namespace orbid::python
