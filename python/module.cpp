#include "python/conversion/bindings.hpp"

PYBIND11_MODULE(_orbid, module) {
    using namespace orbid::python;
    module.doc() = "orbid's C++ library; import orbid for its names.";
    module.attr("__version__") = ORBID_VERSION;
    bind_errors(module);
    bind_arrays(module);
    bind_models(module);
    bind_equations(module);
    bind_periodic(module);
    bind_branches(module);
    bind_jobs(module);
    bind_orbits(module);
    bind_estimator(module);
    bind_identification(module);
}
