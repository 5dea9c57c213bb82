#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include <pybind11/stl.h>

#include "identification/strategy/identify.hpp"
#include "models/system/stopped.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"
#include "python/identification/problem_arguments.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

/// The estimate, and the stages that led to it.
struct Identified : EstimateResult {
    identification::IdentificationResult stages;
};

/// Stops at a signal or an exception, and tells progress(step, share, note): share is None where it is not known.
class PythonObserver final : public identification::Observer {
public:
    PythonObserver(ResidualCall& call, py::handle progress, const std::function<bool()>& stopped)
        : call_(call), progress_(progress), stopped_(stopped) {}

    [[nodiscard]] bool stopped() const override { return stopped_(); }
    [[nodiscard]] bool left() const override { return stopped_(); }
    void stage_ended(const identification::IdentificationResult& so_far) override { reached_ = so_far; }
    void estimated(const identification::IdentificationResult& result) override { reached_ = result; }
    /// What the stages that have ended lead to.
    [[nodiscard]] identification::IdentificationResult interrupted() const {
        identification::IdentificationResult result = reached_;
        result.estimate.status = estimator::EstimateStatus::interrupted;
        return result;
    }
    void begin(const std::string& step, double total, const std::string& /*unit*/) override {
        {
            const std::lock_guard lock(mutex_);
            step_ = step;
            total_ = total;
        }
        tell(0.0, "");
    }
    void at(double done, const std::string& note) override { tell(done, note); }
    void end(const std::string& outcome) override { tell(present().second, outcome); }
    void remark(const std::string& line) override { tell(0.0, line); }

private:
    void tell(double done, const std::string& note) {
        if (!progress_) return;
        const auto [step, total] = present();
        call_.attempt([&, step = step, total = total] {
            progress_(step, total > 0.0 ? py::object(py::float_(done / total)) : py::object(py::none()), note);
        });
    }
    std::pair<std::string, double> present() const {
        const std::lock_guard lock(mutex_);
        return {step_, total_};
    }

    ResidualCall& call_;
    py::handle progress_;
    const std::function<bool()>& stopped_;
    mutable std::mutex mutex_;  ///< of what follows: at() is called from any thread
    std::string step_;
    double total_ = 0.0;
    identification::IdentificationResult reached_;  ///< by the last stage that has ended
};

std::shared_ptr<Identified> identify(const py::object& system, const py::list& records, const py::object& parameters,
                                     const py::kwargs& keywords) {
    identification::IdentificationProblem problem;
    problem.system = system_of(system);
    for (const py::handle record : records)
        problem.experiments.push_back(experiment(record, *problem.system, problem.experiments.size()));
    problem.parameters = model_parameters(parameters, *problem.system);
    NamedArguments given("identify", keywords);
    read_problem(given, problem);
    const identification::Options options = identification_options(given);
    const py::handle progress = progress_function(given);
    given.finish();
    auto result = std::make_shared<Identified>();
    ResidualCall call;
    (void)call.compute([&](const std::function<bool()>& stopped) {
        PythonObserver observer(call, progress, stopped);
        try {
            result->stages = identification::identify(identification::completed(problem), options, observer);
        } catch (const models::Stopped&) {
            result->stages = observer.interrupted();
        }
    });
    result->estimate = result->stages.estimate;
    for (const identification::FreeModelParameter& one : problem.parameters)
        result->parameters.push_back(one.value);
    return result;
}

py::list stage_list(const Identified& one) {
    return listed(one.stages.stages, [](const identification::StageResult& stage) {
        return py::dict("stage"_a = stage.stage, "status"_a = std::string(identification::status_name(stage.status)),
                        "message"_a = stage.message,
                        "parameters"_a = by_name(stage.parameters, &estimator::Estimated::name,
                                                 [](const estimator::Estimated& value) { return py::cast(value); }),
                        "objective"_a = stage.objective, "iterations"_a = stage.iterations,
                        "evaluations"_a = stage.evaluations, "chosen"_a = stage.chosen);
    });
}

py::list matching_list(const Identified& one) {
    return listed(one.stages.matching, [](const identification::MatchingResult& of) {
        py::dict diffusion;
        for (const identification::MatchingResult::Diffusion& noise : of.diffusion)
            diffusion[noise.name.c_str()] = py::dict("value"_a = noise.value, "sd"_a = noise.sd,
                                                     "interval95"_a = py::make_tuple(noise.lower95, noise.upper95),
                                                     "unit"_a = noise.unit, "least"_a = noise.least);
        return py::dict("experiment"_a = of.experiment, "interval"_a = of.interval, "intervals"_a = of.intervals,
                        "large"_a = of.large, "expected"_a = of.expected, "diffusion"_a = diffusion,
                        "warnings"_a = of.warnings);
    });
}

py::dict structure_dict(const Identified& one) {
    const identification::StructuralReport& structure = one.stages.structure;
    const py::list directions = listed(structure.directions, [](const identification::UndeterminedDirection& of) {
        return py::dict("kind"_a = std::string(identification::name(of.kind)), "unknowns"_a = of.unknowns,
                        "components"_a = of.components, "held"_a = of.held, "text"_a = of.text);
    });
    return py::dict("examined"_a = structure.examined, "reason"_a = structure.reason, "directions"_a = directions,
                    "signs"_a = structure.signs);
}

}  // namespace

/// The Python side (orbid/identification.py) makes Series of arrays and columns.
void bind_identification(py::module_& module) {
    py::class_<Identified, EstimateResult, std::shared_ptr<Identified>>(
        module, "Identification", "Result of identify(): an Estimate, and the stages that led to it.")
        .def_property_readonly("stages", &stage_list, "list of dicts, in their order; \"chosen\": the result's")
        .def_property_readonly(
            "cycles", [](const Identified& one) { return one.stages.cycles; },
            "all measured cycles, those of a harvest included")
        .def_property_readonly("matching", &matching_list, "defects at the nodes of each series, as dicts")
        .def_property_readonly("structure", &structure_dict,
                               "what the readings of series can determine, found before the fit: \"directions\" that "
                               "they cannot, \"signs\" that are a matter of choice");
    module.def("identify", &identify, py::arg("system"), py::arg("records"), py::arg("parameters"));
}

}  // namespace orbid::python
