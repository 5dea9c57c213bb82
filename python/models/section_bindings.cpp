#include <utility>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

std::string status_name(models::FlowStatus status) {
    return status == models::FlowStatus::ok ? "ok" : std::string(models::description(status));
}

struct Crossings {
    std::string status;
    py::array_t<double> times, states, sensitivities, time_sensitivities;
    std::vector<std::string> directions;
};

Crossings crossings(const models::System& system, const py::object& x0, const py::object& section, std::size_t count,
                    const py::object& parameters, const py::object& sensitivities, double longest, double rtol,
                    double atol, std::size_t maximum_steps) {
    const Eigen::VectorXd start = vector(finite_vector(x0, "x0", system.dimension()));
    const auto at = plane(system, section);
    if (!at) throw py::type_error("section: None; a dict is needed");
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto free = free_parameters(system, sensitivities);
    std::optional<std::span<const Eigen::Index>> directions;
    if (free) directions = *free;
    const auto options = flow_options(rtol, atol, maximum_steps);
    auto result = unlocked([&] { return system.crossings(start, *at, count, longest, theta, directions, options); });
    const py::ssize_t reached = result.states.cols();
    Crossings found{status_name(result.status),
                    array(std::move(result.times)),
                    array(std::move(result.states)),
                    py::array_t<double>(std::vector<py::ssize_t>{reached, system.dimension(), 0}),
                    py::array_t<double>(std::vector<py::ssize_t>{reached, 0}),
                    {}};
    if (free) {
        found.directions = direction_names(system, *free);
        found.sensitivities =
            derivative_array(std::move(result.sensitivities), static_cast<py::ssize_t>(found.directions.size()));
        found.time_sensitivities = array(std::move(result.time_sensitivities));
    }
    return found;
}

struct Ensemble {
    py::list sections, times;
    std::vector<std::string> status;
};

Ensemble ensemble(const models::System& system, const py::object& starts, std::size_t count,
                  const py::object& parameters, double phase, const py::object& section, double longest, double rtol,
                  double atol, std::size_t maximum_steps) {
    const Eigen::MatrixXd from = matrix(records(starts, "starts", system.dimension()));
    const auto at = plane(system, section);
    if (at.has_value() != (system.kind() == models::Kind::autonomous))
        throw py::value_error(at ? "section: of autonomous models; this one has one section per period or iteration"
                                 : "section: an autonomous model needs one");
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto options = flow_options(rtol, atol, maximum_steps);
    auto result = unlocked([&] {
        return at ? system.crossing_ensemble(from, *at, count, longest, theta, options)
                  : system.ensemble(from, phase, count, theta, options);
    });
    Ensemble all;
    for (Eigen::MatrixXd& points : result.sections)
        all.sections.append(array(std::move(points)));
    for (Eigen::VectorXd& times : result.times)
        all.times.append(array(std::move(times)));
    for (const models::FlowStatus status : result.status)
        all.status.push_back(status_name(status));
    return all;
}

py::tuple readings(const models::System& system, const py::object& sensor, const py::object& states,
                   const py::object& parameters, const py::object& sensitivities, const py::object& phase) {
    const Doubles given = records(states, "states", system.dimension());
    const auto at = phases(phase, given.shape(0));
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto free = free_parameters(system, sensitivities);
    const models::Sensor instrument = python::sensor(sensor, system);
    std::optional<std::span<const Eigen::Index>> directions;
    if (free) directions = *free;
    const Eigen::MatrixXd columns = matrix(given);
    auto result = unlocked([&] { return system.readings(instrument, columns, at, theta, directions); });
    if (result.status != models::FlowStatus::ok) throw py::value_error("readings: " + status_name(result.status));
    py::array_t<double> derivatives(std::vector<py::ssize_t>{given.shape(0), given.shape(1), 0});
    if (free)
        derivatives = derivative_array(std::move(result.derivatives),
                                       system.dimension() + static_cast<py::ssize_t>(free->size()));
    return py::make_tuple(array(std::move(result.readings)), derivatives);
}

/// [s] without a crossing after which a trajectory is given up: thousands of returns of the models in the registry.
constexpr double longest_return = 1e4;

}  // namespace

void bind_sections(py::module_& module, SystemClass& system) {
    py::class_<Crossings>(module, "Crossings", "Crossings of a section by one trajectory.")
        .def_readonly("status", &Crossings::status, "'ok', or why fewer crossings were found.")
        .def_readonly("times", &Crossings::times, "Shape (m,): since the start [s].")
        .def_readonly("states", &Crossings::states, "Shape (m, n).")
        .def_readonly("sensitivities", &Crossings::sensitivities,
                      "Shape (m, n, d), of the point on the section; d = 0 unless asked for.")
        .def_readonly("time_sensitivities", &Crossings::time_sensitivities, "Shape (m, d).")
        .def_readonly("directions", &Crossings::directions, "Names of the d directions.");
    py::class_<Ensemble>(module, "Ensemble", "Sections of many trajectories.")
        .def_readonly("sections", &Ensemble::sections, "One array for each trajectory, shape (count + 1, n).")
        .def_readonly("times", &Ensemble::times, "Autonomous models: times of the crossings [s]; else empty.")
        .def_readonly("status", &Ensemble::status, "'ok' or why a trajectory has fewer rows.");
    constexpr models::FlowOptions standard{};
    const auto rtol = py::arg_v("rtol", standard.relative_tolerance);
    const auto atol = py::arg_v("atol", standard.absolute_tolerance);
    const auto steps = py::arg_v("maximum_steps", standard.maximum_steps);
    system
        .def("crossings", &crossings, py::arg("x0"), py::arg("section"), py::arg("count"),
             py::arg("parameters") = py::none(), py::kw_only(), py::arg("sensitivities") = false,
             py::arg("longest") = longest_return, rtol, atol, steps,
             "The next crossings of a section, {'coordinate': 'z', 'value': 27, 'direction': -1} or\n"
             "{'normal': [..], 'offset': ..}, by an autonomous flow. longest: time [s] without one until it is given "
             "up.")
        .def("ensemble", &ensemble, py::arg("starts"), py::arg("count"), py::arg("parameters") = py::none(),
             py::kw_only(), py::arg("phase") = 0.0, py::arg("section") = py::none(),
             py::arg("longest") = longest_return, rtol, atol, steps,
             "Sections of many trajectories, from the rows of starts (m, n): one per period of the forcing, iteration, "
             "or\ncrossing of the section. In parallel; the same bytes with any number of threads.")
        .def("readings", &readings, py::arg("sensor"), py::arg("states"), py::arg("parameters") = py::none(),
             py::kw_only(), py::arg("sensitivities") = py::none(), py::arg("phase") = 0.0,
             "What a sensor, given as in a job, reads at states (m, n): readings (m, n), and derivatives (m, n, d) by "
             "the\nstate and the named parameters, d = 0 unless sensitivities is given ([] for the state alone).");
}

}  // namespace orbid::python
