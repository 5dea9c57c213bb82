#include "python/bindings.hpp"

namespace orbid::python {

void bind_branches(pybind11::module_& /*module*/) {}

}  // namespace orbid::python
