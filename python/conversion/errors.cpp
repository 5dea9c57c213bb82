#include <exception>
#include <filesystem>
#include <stdexcept>

#include "orbits/records/data_error.hpp"
#include "python/conversion/bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

/// Wrong calls are ValueErrors (pybind11 does so with std::invalid_argument); what a model does not offer as well.
void bind_errors(py::module_& module) {
    // Never freed: a translator may be asked when the interpreter is gone already.
    static auto* data_error = new py::exception<orbits::DataError>(module, "DataError", PyExc_ValueError);
    data_error->attr("__doc__") = "Recorded data that cannot be read or used; names file, line and column.";
    // Of this module alone: other modules throw exceptions of the standard library as well.
    py::register_local_exception_translator([](std::exception_ptr thrown) {
        if (!thrown) return;
        try {
            std::rethrow_exception(thrown);
        } catch (const orbits::DataError& error) {
            (*data_error)(error.what());
        } catch (const std::filesystem::filesystem_error& error) {
            PyErr_SetString(PyExc_OSError, error.what());
        } catch (const std::invalid_argument& error) {
            PyErr_SetString(PyExc_ValueError, error.what());
        } catch (const py::cast_error& error) {
            PyErr_SetString(PyExc_TypeError, error.what());
        } catch (const std::out_of_range& error) {
            PyErr_SetString(PyExc_IndexError, error.what());
        } catch (const std::logic_error& error) {
            PyErr_SetString(PyExc_ValueError, error.what());
        }
    });
}

}  // namespace orbid::python
