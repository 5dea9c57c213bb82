#include "python/bindings.hpp"

namespace orbid::python {

void bind_periodic(pybind11::module_& /*module*/) {}

}  // namespace orbid::python
