#include "python/bindings.hpp"

namespace orbid::python {

void bind_estimator(pybind11::module_& /*module*/) {}

}  // namespace orbid::python
