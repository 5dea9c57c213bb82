#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "models/equations/equation_text.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using models::EquationText;

/// The key of a model that a part is written under; none for the model as a whole.
const char* part_name(models::EquationProblem::Part part) {
    constexpr const char* names[] = {"",          "equations", "definitions", "parameters", "forcing_phase",
                                     "switching", "inputs",    "symmetry"};
    return names[static_cast<std::size_t>(part)];
}

/// Problems as (key, index, character or None, rule), the system only where there are none.
py::tuple system_of(const EquationText& text) {
    std::vector<models::EquationProblem> problems;
    const auto system = models::system_from_text(text, problems);
    const py::list list = listed(problems, [](const models::EquationProblem& problem) {
        return py::make_tuple(part_name(problem.part), problem.index, problem.position, problem.rule);
    });
    return py::make_tuple(problems.empty() ? held(system) : nullptr, list);
}

}  // namespace

/// The Python side (orbid/equation.py) reads the keys; this is the library's own form of them.
void bind_equations(py::module_& module) {
    using Domain = models::Domain;
    py::class_<EquationText> text(module, "EquationText");
    text.def(py::init<>())
        .def_readwrite("name", &EquationText::name)
        .def_readwrite("map", &EquationText::map)
        .def_readwrite("stiff", &EquationText::stiff)
        .def_readwrite("switching", &EquationText::switching)
        .def("add_coordinate",
             [](EquationText& self, const std::string& name, const std::string& formula, const std::string& unit,
                bool angle) {
                 self.coordinates.push_back({name, formula, unit, angle});
             })
        .def("add_definition",
             [](EquationText& self, const std::string& name, const std::string& formula) {
                 self.definitions.push_back({name, formula});
             })
        .def("add_parameter",
             [](EquationText& self, const std::string& name, const std::string& unit, const std::string& domain,
                double value, std::optional<double> typical, const std::string& description) {
                 const Domain where = domain == "positive"      ? Domain::positive
                                      : domain == "nonnegative" ? Domain::nonnegative
                                                                : Domain::real;
                 self.parameters.push_back({name, unit, where, value, typical, description});
             })
        .def("add_input",
             [](EquationText& self, const std::string& name, const std::string& unit) {
                 self.inputs.push_back({name, "", unit});
             })
        .def("set_forcing",
             [](EquationText& self, const std::string& phase, const std::string& frequency) {
                 self.forcing = {phase, frequency};
             })
        .def("set_symmetry", [](EquationText& self, const std::vector<double>& signs, double phase_shift) {
            self.symmetry = models::Symmetry{signs, phase_shift};
        });
    module.def("system_from_text", &system_of);
}

}  // namespace orbid::python
