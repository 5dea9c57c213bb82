#include "estimator/exploration/multi_start.hpp"

#include <utility>

#include <pybind11/stl.h>

#include "estimator/interface/mapped_residual.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

/// Residuals that a function in Python makes anew for every run; the call keeps them alive.
class Makers {
public:
    Makers(ResidualCall& call, py::handle factory, Eigen::Index parameters)
        : call_(&call), factory_(factory), parameters_(parameters) {}

    /// Wrapped, for the run owns what it gets.
    std::vector<std::unique_ptr<estimator::Residual>> operator()() {
        std::vector<std::unique_ptr<estimator::Residual>> wrapped;
        const py::gil_scoped_acquire lock;
        try {
            py::object made = factory_();
            if (py::isinstance<estimator::Residual>(made)) {
                py::list only;
                only.append(made);
                made = only;
            }
            for (const py::handle one : made) {
                call_->add(one);
                wrapped.push_back(std::make_unique<estimator::MappedResidual>(
                    *call_->residuals().back(), estimator::ParameterMap::identity(parameters_)));
            }
        } catch (...) {
            call_->fail(std::current_exception());
            throw std::runtime_error("the function that makes residuals failed");
        }
        return wrapped;
    }

private:
    ResidualCall* call_;
    py::handle factory_;
    Eigen::Index parameters_;
};

py::dict run_dict(const estimator::StartedRun& run) {
    return py::dict("start"_a = run.start, "from"_a = array(Eigen::VectorXd(run.from)),
                    "theta"_a = array(Eigen::VectorXd(run.theta)), "status"_a = std::string(name(run.status)),
                    "message"_a = run.message, "objective"_a = run.objective, "records"_a = run.records,
                    "evaluations"_a = run.evaluations, "optimum"_a = run.optimum, "screened"_a = run.screened);
}

py::dict multi_start(py::handle parameters, py::object residuals, py::handle derived, const py::kwargs& keywords) {
    auto best = std::make_shared<EstimateResult>();
    best->parameters = estimated_parameters(parameters);
    best->derived = derived_functions(derived);
    if (PyCallable_Check(residuals.ptr()) == 0)
        throw py::type_error("residuals: needs a function that returns fresh residuals at each call");
    ResidualCall call;
    Makers makers(call, residuals, std::ssize(best->parameters));
    NamedArguments given("multi_start", keywords);
    const auto quantities = derived_quantities(best->derived, call);
    estimator::MultiStartOptions options;
    options.starts = static_cast<int>(given.integer("starts", options.starts, 1));
    options.seed = static_cast<std::uint64_t>(given.integer("seed", 1, 0));
    options.width = given.number("width", options.width);
    options.screening_iterations =
        static_cast<int>(given.integer("screening_iterations", options.screening_iterations, 0));
    options.kept = static_cast<int>(given.integer("kept", options.kept, 1));
    options.distance = given.number("distance", options.distance);
    options.objective_tolerance = given.number("objective_tolerance", options.objective_tolerance);
    options.estimate = estimate_options(given);
    if (const py::object progress = given.find_value("progress")) {
        if (PyCallable_Check(progress.ptr()) == 0) throw py::type_error("multi_start: progress: needs a function");
        // The keyword arguments keep the function.
        options.progress = [&call, function = progress.ptr()](int finished, int total) {
            if (call.failed()) return;
            const py::gil_scoped_acquire lock;
            try {
                (void)py::handle{function}(finished, total);
            } catch (...) {
                call.fail(std::current_exception());
            }
        };
    }
    given.finish();
    estimator::MultiStart found;
    (void)call.compute([&](const std::function<bool()>& stopped) {
        options.estimate.interrupted = stopped;
        found = estimator::multi_start(
            best->parameters, [&makers] { return makers(); }, quantities, options);
    });
    py::dict dict;
    best->estimate = std::move(found.best);
    dict["best"] = best;
    dict["best_start"] = found.best_start;
    py::list optima;
    for (const estimator::Optimum& optimum : found.optima) {
        optima.append(py::dict("objective"_a = optimum.objective, "theta"_a = array(Eigen::VectorXd(optimum.theta)),
                               "starts"_a = optimum.starts));
    }
    dict["optima"] = optima;
    py::list runs;
    for (const estimator::StartedRun& run : found.runs)
        runs.append(run_dict(run));
    dict["runs"] = runs;
    dict["interrupted"] = found.interrupted;
    return dict;
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
