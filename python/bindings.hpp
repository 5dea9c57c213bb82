#pragma once

#include <pybind11/pybind11.h>

namespace orbid::python {

/// Each adds the functions and classes of one part to the module.
void bind_errors(pybind11::module_& module);
void bind_models(pybind11::module_& module);
void bind_flow(pybind11::module_& module);
void bind_equations(pybind11::module_& module);
void bind_periodic(pybind11::module_& module);
void bind_branches(pybind11::module_& module);
void bind_jobs(pybind11::module_& module);
void bind_orbits(pybind11::module_& module);
void bind_estimator(pybind11::module_& module);

}  // namespace orbid::python
