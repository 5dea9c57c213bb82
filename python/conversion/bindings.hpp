#pragma once

#include <memory>

#include <pybind11/pybind11.h>

#include "models/system/system.hpp"

namespace orbid::python {

/// Systems are const in the library. Python has no const, and nothing in these bindings changes a system.
using SystemClass = pybind11::class_<models::System, std::shared_ptr<models::System>>;

[[nodiscard]] inline std::shared_ptr<models::System> held(const std::shared_ptr<const models::System>& system) {
    return std::const_pointer_cast<models::System>(system);
}

/// Adds what a system computes to its class.
void bind_flow(pybind11::module_& module, SystemClass& system);
void bind_sections(pybind11::module_& module, SystemClass& system);

/// Each function adds the functions and classes of one part to the module.
void bind_errors(pybind11::module_& module);
void bind_arrays(pybind11::module_& module);
void bind_models(pybind11::module_& module);
void bind_equations(pybind11::module_& module);  // needs the models
void bind_periodic(pybind11::module_& module);
void bind_branches(pybind11::module_& module);
void bind_jobs(pybind11::module_& module);
void bind_orbits(pybind11::module_& module);
void bind_estimator(pybind11::module_& module);
void bind_identification(pybind11::module_& module);  // needs the estimator

}  // namespace orbid::python
