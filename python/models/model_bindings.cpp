#include <string>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "models/catalogue/registry.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

std::string kind_name(models::Kind kind) {
    if (kind == models::Kind::map) return "map";
    return kind == models::Kind::forced ? "forced" : "autonomous";
}

/// Text of a row, which refers to that of the system.
template <class Row>
auto text_of(std::string_view Row::*which) {
    return [which](const Row& row) { return std::string(row.*which); };
}

void bind_rows(py::module_& module) {
    py::class_<models::Parameter>(module, "Parameter", "A row of a model's parameter table.")
        .def_property_readonly("name", text_of(&models::Parameter::name))
        .def_property_readonly("unit", text_of(&models::Parameter::unit))
        .def_property_readonly(
            "domain", [](const models::Parameter& row) { return std::string(models::rule(row.domain)); },
            "The rule in words: 'a finite number', '> 0', '>= 0'.")
        .def_readonly("default", &models::Parameter::default_value)
        .def_property_readonly("description", text_of(&models::Parameter::description))
        .def_readonly("typical_size", &models::Parameter::typical_size)
        .def("__repr__", [](const models::Parameter& row) {
            return "Parameter(" + std::string(row.name) + " = " + std::string(py::str(py::float_(row.default_value))) +
                   " [" + std::string(row.unit) + "], " + std::string(models::rule(row.domain)) + ")";
        });
    py::class_<models::Coordinate>(module, "Coordinate", "A coordinate of a model's state, or a measured input.")
        .def_property_readonly("name", text_of(&models::Coordinate::name))
        .def_property_readonly("unit", text_of(&models::Coordinate::unit))
        .def_readonly("angle", &models::Coordinate::angle, "On the circle of 2 pi rad.")
        .def("__repr__", [](const models::Coordinate& row) {
            return "Coordinate(" + std::string(row.name) + " [" + std::string(row.unit) + "]" +
                   (row.angle ? ", angle)" : ")");
        });
}

/// Copies of the rows, which refer to the system's text: they keep it alive.
template <class Row>
py::list rows(const py::object& system, std::span<const Row> table) {
    return listed(table, [&](const Row& row) {
        py::object item = py::cast(row, py::return_value_policy::copy);
        py::detail::keep_alive_impl(item, system);
        return item;
    });
}

void bind_description(SystemClass& system) {
    const auto of = [](const py::object& self) -> const models::System& { return self.cast<const models::System&>(); };
    system.def_property_readonly("name", [](const models::System& self) { return std::string(self.name()); })
        .def_property_readonly(
            "variant", [](const models::System& self) { return std::string(self.variant()); }, "'' where it has none.")
        .def_property_readonly("kind", [](const models::System& self) { return kind_name(self.kind()); })
        .def_property_readonly("dimension", &models::System::dimension)
        .def_property_readonly("coordinates",
                               [of](const py::object& self) { return rows(self, of(self).coordinates()); })
        .def_property_readonly("parameters", [of](const py::object& self) { return rows(self, of(self).parameters()); })
        .def_property_readonly("inputs", [of](const py::object& self) { return rows(self, of(self).inputs()); })
        .def_property_readonly("stiff", &models::System::stiff)
        .def_property_readonly(
            "symmetry",
            [](const models::System& self) -> py::object {
                const auto symmetry = self.symmetry();
                if (!symmetry) return py::none();
                return py::make_tuple(symmetry->signs, symmetry->phase_shift);
            },
            "(signs, phase shift [rad]) of the symmetry x -> S x, None without one.")
        .def(
            "values",
            [](const models::System& self, const py::object& parameters) {
                return array(parameter_values(self, parameters));
            },
            py::arg("parameters") = py::none(),
            "All parameters in the order of the table: the defaults, replaced by those of a dict.")
        .def("__repr__", [](const models::System& self) {
            const std::string variant(self.variant());
            return "System(" + std::string(self.name()) + (variant.empty() ? "" : ", " + variant) + ", " +
                   kind_name(self.kind()) + ", " + std::to_string(self.dimension()) + " coordinates)";
        });
}

py::list listing() {
    return listed(models::registered_models(), [](const models::ModelEntry& entry) {
        return py::dict("name"_a = std::string(entry.name), "summary"_a = std::string(entry.summary),
                        "equations"_a = std::string(entry.equations),
                        "variants"_a = std::vector<std::string>(entry.variants.begin(), entry.variants.end()),
                        "size"_a = entry.size ? py::object(py::int_(entry.size->standard)) : py::object(py::none()));
    });
}

}  // namespace

void bind_models(py::module_& module) {
    bind_rows(module);
    SystemClass system(module, "System", "A model: equations, names and flow; holds no parameter values.");
    bind_description(system);
    bind_flow(module, system);
    bind_sections(module, system);
    module.def("models", &listing, "The models that come with orbid, a dict each.");
    module.def(
        "model",
        [](const std::string& name, const std::string& variant, std::optional<std::size_t> size) {
            return held(models::make_system(name, variant, size));
        },
        py::arg("name"), py::arg("variant") = "", py::arg("size") = py::none(),
        "A model by its name. size: number of cells of models that have any number.");
}

}  // namespace orbid::python
