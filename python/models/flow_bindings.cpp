#include <utility>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

struct Flow {
    std::string status;
    py::array_t<double> states, sensitivities;
    std::vector<std::string> directions;
    double stopped_after = 0.0;
    py::array_t<double> stopped_state;
    std::size_t steps = 0, crossings = 0, stickings = 0;
};

models::Clock clock_of(const models::System& system, const std::string& name) {
    (void)choice_of(name, {"time", "phase"}, "clock");
    if (name == "phase" && system.kind() != models::Kind::forced)
        throw py::value_error("clock: 'phase' is for forced models");
    return name == "phase" ? models::Clock::phase : models::Clock::time;
}

Flow flow(const models::System& system, const py::object& x0, const py::object& t, const py::object& parameters,
          const py::object& sensitivities, double phase, const std::string& clock, double rtol, double atol,
          std::size_t maximum_steps) {
    const Eigen::VectorXd start = vector(finite_vector(x0, "x0", system.dimension()));
    const Doubles durations = finite_vector(t, "t");
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto free = free_parameters(system, sensitivities);
    const models::Clock unit = clock_of(system, clock);
    const models::FlowOptions options = flow_options(rtol, atol, maximum_steps);
    auto result = unlocked([&] {
        return free ? system.flow_with_sensitivities(start, phase, span(durations), theta, *free, unit, options)
                    : system.flow(start, phase, span(durations), theta, unit, options);
    });
    const py::ssize_t count = result.states.cols();
    Flow flow{result.status == models::FlowStatus::ok ? "ok" : std::string(models::description(result.status)),
              array(std::move(result.states)),
              py::array_t<double>(std::vector<py::ssize_t>{count, system.dimension(), 0}),
              {},
              result.stopped_after,
              array(std::move(result.stopped_state)),
              result.steps,
              result.crossings,
              result.stickings};
    if (free) {
        flow.directions = direction_names(system, *free);
        flow.sensitivities =
            derivative_array(std::move(result.sensitivities), static_cast<py::ssize_t>(flow.directions.size()));
    }
    return flow;
}

/// One state or several: the result has the shape of what was given.
struct States {
    Doubles array;
    bool one;

    [[nodiscard]] py::array like(const py::array& results) const {
        return one ? py::array(results[py::int_(0)]) : results;
    }
};
States states_of(const models::System& system, const py::object& x) {
    const Doubles array = doubles(x, "x");
    return {records(array, "x", system.dimension()), array.ndim() == 1};
}

py::array rhs(const models::System& system, const py::object& x, const py::object& parameters,
              const py::object& phase) {
    const States given = states_of(system, x);
    const auto at = phases(phase, given.array.shape(0));
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const Eigen::MatrixXd states = matrix(given.array);
    return given.like(array(unlocked([&] { return system.rhs(states, at, theta); })));
}

py::array rhs_derivatives(const models::System& system, const py::object& x, const py::object& parameters,
                          const py::object& sensitivities, const py::object& phase) {
    const States given = states_of(system, x);
    const auto at = phases(phase, given.array.shape(0));
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto free = free_parameters(system, sensitivities).value_or(std::vector<Eigen::Index>{});
    const Eigen::MatrixXd states = matrix(given.array);
    const py::ssize_t directions = static_cast<py::ssize_t>(free.size()) + system.dimension();
    return given.like(
        derivative_array(unlocked([&] { return system.rhs_derivatives(states, at, theta, free); }), directions));
}

std::shared_ptr<models::System> with_input(const models::System& system, const py::object& times,
                                           const py::object& values, const std::string& interpolation) {
    using Interpolation = models::InputSignal::Interpolation;
    const auto count = system.inputs().size();
    const Doubles instants = finite_vector(times, "times");
    Doubles readings = doubles(values, "values");
    if (readings.ndim() == 1 && count == 1) readings = Doubles(readings.reshape({readings.size(), py::ssize_t{1}}));
    readings = records(readings, "values", static_cast<py::ssize_t>(count));
    if (readings.shape(0) != instants.size())
        throw py::value_error("values: " + std::to_string(readings.shape(0)) + " records, needs one for each of " +
                              std::to_string(instants.size()) + " times");
    constexpr Interpolation kinds[] = {Interpolation::linear, Interpolation::cubic, Interpolation::held,
                                       Interpolation::band_limited};
    const std::size_t kind = choice_of(interpolation, {"linear", "cubic", "held", "band_limited"}, "interpolation");
    return held(system.with_input(
        std::make_shared<const models::InputSignal>(span(instants), span(readings), count, kinds[kind])));
}

}  // namespace

void bind_flow(py::module_& module, SystemClass& system) {
    py::class_<Flow>(module, "Flow", "States of one trajectory, with derivatives when asked for.")
        .def_readonly("status", &Flow::status, "'ok', or why the trajectory could not be continued.")
        .def_property_readonly("ok", [](const Flow& flow) { return flow.status == "ok"; })
        .def_readonly("states", &Flow::states, "Shape (m, n): row k after duration t[k]; angles are not wrapped.")
        .def_readonly("sensitivities", &Flow::sensitivities,
                      "Shape (m, n, d): d states[k, i] / d direction j; d = 0 unless asked for.")
        .def_readonly("directions", &Flow::directions, "Names of the d directions.")
        .def_readonly("stopped_after", &Flow::stopped_after, "Duration reached.")
        .def_readonly("stopped_state", &Flow::stopped_state, "Shape (n): the state there.")
        .def_readonly("steps", &Flow::steps)
        .def_readonly("crossings", &Flow::crossings, "Switching events located.")
        .def_readonly("stickings", &Flow::stickings, "Intervals of sticking entered.");
    constexpr models::FlowOptions standard{};
    system
        .def("flow", &flow, py::arg("x0"), py::arg("t"), py::arg("parameters") = py::none(), py::kw_only(),
             py::arg("sensitivities") = false, py::arg("phase") = 0.0, py::arg("clock") = "time",
             py::arg("rtol") = standard.relative_tolerance, py::arg("atol") = standard.absolute_tolerance,
             py::arg("maximum_steps") = standard.maximum_steps,
             "States after the durations t (ascending, >= 0) from x0.\n\n"
             "parameters: a dict (others keep their defaults) or all values in the order of the table.\n"
             "sensitivities: names of parameters, for derivatives by the start and by them; True: all, []: none of "
             "them.\n"
             "phase: of the forcing at the start [rad]; of models with inputs: the time [s] of the start.\n"
             "clock: t in 'time' [s] (iterations of a map) or 'phase' [rad] of the forcing.")
        .def("rhs", &rhs, py::arg("x"), py::arg("parameters") = py::none(), py::kw_only(), py::arg("phase") = 0.0,
             "x' = f(x): shape (n,) or (m, n), as x; phase: one or one for each state.")
        .def("rhs_derivatives", &rhs_derivatives, py::arg("x"), py::arg("parameters") = py::none(), py::kw_only(),
             py::arg("sensitivities") = false, py::arg("phase") = 0.0,
             "Derivatives of f by the state and then the named parameters: shape (n, d) or (m, n, d).")
        .def("with_input", &with_input, py::arg("times"), py::arg("values"), py::kw_only(),
             py::arg("interpolation") = "linear",
             "The same model reading this signal: times (m,), values (m, inputs), in between 'linear', "
             "'cubic', 'held' or 'band_limited'.")
        .def(
            "period",
            [](const models::System& self, const py::object& parameters, const std::string& clock) {
                return self.period(parameter_values(self, parameters), clock_of(self, clock));
            },
            py::arg("parameters") = py::none(), py::kw_only(), py::arg("clock") = "time",
            "Period of the forcing in s, or in rad by clock='phase'.");
}

}  // namespace orbid::python
