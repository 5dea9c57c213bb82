
#include <pybind11/stl.h>

#include "orbits/simulation/virtual_experiment.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

constexpr auto simulate_text = R"(A record as an experiment would take it: .series, .events, .complete, .message.

parameters   dict, array of all, or None: the model's defaults.
sections     how many, of all trajectories together: forced models and maps; autonomous ones at a `section`, which is a
             dict as in a job, {"coordinate": "z", "value": 27, "direction": -1}; or
step, count  [s] samples in time of each trajectory.
transient    sections (300) or samples (0) left out at the start; trajectories (1); initial, shape (trajectories, n);
             random_range, shape (n,); restart (True); phase [rad]; sensor as in a job; noise, noise_correlation, shape
             (n,); seed (0); longest_return [s]; rtol, atol, maximum_steps.)";

orbits::VirtualExperimentOptions experiment(NamedArguments& given, const models::System& system) {
    orbits::VirtualExperimentOptions options;
    const bool sections = given.has("sections");
    if (sections == (given.has("step") || given.has("count")))
        throw py::type_error("simulate: needs either sections, or step and count");
    if (sections) {
        orbits::SectionPlan plan;
        given.take({{"sections", plan.sections, 1}, {"transient", plan.transient}});
        const py::object crossed = given.find_value("section");
        if (crossed) plan.section = plane(system, crossed);
        given.take("longest_return", plan.longest_return);
        options.plan = plan;
    } else {
        orbits::SamplePlan plan;
        plan.step = given.required_number("step");
        given.take({{"count", plan.count, 1}, {"transient", plan.transient}});
        options.plan = plan;
    }
    given.take("trajectories", options.trajectories, 1);
    if (const py::object initial = given.find_value("initial")) {
        const Doubles starts = records(initial, "initial", system.dimension());
        options.initial = matrix(starts);
        if (!given.has("trajectories")) options.trajectories = static_cast<std::size_t>(starts.shape(0));
    }
    given.take("random_range", options.random_range);
    options.restart = given.flag("restart", true) ? orbits::Restart::when_captured_or_at_rest : orbits::Restart::never;
    given.take("phase", options.phase);
    options.sensor = sensor(given.find("sensor"), system);
    given.take({{"noise", options.noise}, {"noise_correlation", options.noise_correlation}, {"seed", options.seed}});
    options.flow = flow_options(given, options.flow);
    return options;
}

py::list event_list(const orbits::VirtualExperiment& experiment) {
    return listed(experiment.events, [](const orbits::TrajectoryEvent& event) {
        return py::dict("kind"_a = std::string(name(event.kind)), "trajectory"_a = event.trajectory,
                        "section"_a = event.section, "period"_a = event.period,
                        "state"_a = array(Eigen::VectorXd(event.state)));
    });
}

}  // namespace

void bind_simulation(py::module_& module) {
    using orbits::VirtualExperiment;
    py::class_<VirtualExperiment, std::shared_ptr<VirtualExperiment>>(module, "VirtualExperiment",
                                                                      "A simulated record and what happened.")
        .def_property_readonly("series",
                               [](const std::shared_ptr<VirtualExperiment>& one) {
                                   // Belongs to the experiment, and keeps it.
                                   return std::shared_ptr<orbits::Series>(one, &one->series);
                               })
        .def_property_readonly("events", &event_list, "captured, at_rest, failed, restarted: where and when")
        .def_readonly("complete", &VirtualExperiment::complete)
        .def_readonly("message", &VirtualExperiment::message);
    module.def(
        "simulate",
        [](const py::object& system, const py::object& parameters, const py::kwargs& keywords) {
            const auto model = system_of(system);
            const Eigen::VectorXd theta = parameter_values(*model, parameters);
            NamedArguments given("simulate", keywords);
            const orbits::VirtualExperimentOptions options = experiment(given, *model);
            given.finish();
            return std::make_shared<VirtualExperiment>(
                computed_interruptibly([&] { return orbits::simulate(*model, theta, options); }));
        },
        py::arg("system"), py::arg("parameters") = py::none(), simulate_text);
}

}  // namespace orbid::python
