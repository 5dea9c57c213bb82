#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "models/registry.hpp"
#include "python/arguments.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

void bind_models(py::module_& module) {
    py::class_<models::System, std::shared_ptr<models::System>>(module, "System")
        .def_property_readonly("name", [](const models::System& system) { return std::string(system.name()); });
    module.def(
        "model",
        [](const std::string& name, const std::string& variant, std::optional<std::size_t> size) {
            return std::const_pointer_cast<models::System>(models::make_system(name, variant, size));
        },
        py::arg("name"), py::kw_only(), py::arg("variant") = "", py::arg("size") = py::none());
}

}  // namespace orbid::python
