#include "python/conversion/bindings.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

void bind_orbits(pybind11::module_& module) {
    bind_series(module);
    bind_series_files(module);
    bind_simulation(module);
    bind_cycles(module);
    bind_invariants(module);
}

}  // namespace orbid::python
