#include "python/conversion/arrays.hpp"

#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

std::string shape_of(const py::array& array) {
    return py::str(array.attr("shape"));
}

[[noreturn]] void refuse_numbers(const std::string& name, const std::string& what) {
    throw py::type_error(name + ": " + what + "; real numbers are needed");
}

/// float64 has 53 bits.
void check_whole_numbers(const py::array& array, const std::string& name) {
    const py::object numpy = py::module_::import("numpy");
    constexpr long long largest = 1LL << 53;
    if (array.size() > 0 && (numpy.attr("any")(array.attr("__gt__")(largest)).cast<bool>() ||
                             numpy.attr("any")(array.attr("__lt__")(-largest)).cast<bool>()))
        throw py::value_error(name + ": holds an integer beyond 2^53, which float64 does not hold exactly");
}

/// "name[3, 1]" of an entry by its number.
std::string entry_name(const Doubles& array, const std::string& name, py::ssize_t entry) {
    std::string index;
    for (py::ssize_t axis = array.ndim(); axis-- > 0; entry /= array.shape(axis))
        index = std::to_string(entry % array.shape(axis)) + (index.empty() ? "" : ", ") + index;
    return name + (index.empty() ? "" : "[" + index + "]");
}

void check_finite(const Doubles& array, const std::string& name, bool missing) {
    const double* entries = array.data();
    for (py::ssize_t k = 0; k < array.size(); ++k)
        if (!std::isfinite(entries[k]) && !(missing && std::isnan(entries[k])))
            throw py::value_error(entry_name(array, name, k) + " = " + std::to_string(entries[k]) +
                                  ": must be a finite number");
}

/// An array that owns what it shows.
template <class Owned>
py::array_t<double> owning(Owned&& value, py::array::ShapeContainer shape, py::array::StridesContainer strides) {
    using Stored = std::remove_cvref_t<Owned>;
    auto owned = std::make_unique<Stored>(std::forward<Owned>(value));
    const double* data = owned->data();
    const py::capsule owner(owned.get(), [](void* stored) { delete static_cast<Stored*>(stored); });
    owned.release();
    return {std::move(shape), std::move(strides), data, owner};
}

constexpr py::ssize_t width = sizeof(double);

}  // namespace

Doubles doubles(py::handle argument, const char* name) {
    if (!argument || argument.is_none()) refuse_numbers(name, "None");
    const py::object numpy = py::module_::import("numpy");
    const py::array given = numpy.attr("asarray")(argument);
    if (py::isinstance(argument, numpy.attr("ma").attr("MaskedArray")))
        refuse_numbers(name, "a masked array, whose mask would be lost");
    const char kind = given.dtype().kind();
    const bool whole = kind == 'i' || kind == 'u';
    if (!whole && (kind != 'f' || given.itemsize() > width))
        refuse_numbers(name, "numbers of type " + std::string(py::str(given.dtype())));
    if (whole) check_whole_numbers(given, name);
    return Doubles(given);
}

Doubles finite_vector(py::handle argument, const char* name, std::optional<py::ssize_t> size) {
    Doubles array = doubles(argument, name);
    if (array.ndim() == 0) array = Doubles(array.reshape({1}));
    if (array.ndim() != 1)
        throw py::value_error(std::string(name) + ": shape " + shape_of(array) + ", needs one dimension");
    if (size && array.size() != *size)
        throw py::value_error(std::string(name) + ": " + std::to_string(array.size()) + " entries, needs " +
                              std::to_string(*size));
    check_finite(array, name, false);
    return array;
}

Doubles records(py::handle argument, const char* name, py::ssize_t columns, bool missing) {
    Doubles array = doubles(argument, name);
    if (array.ndim() == 1 && array.size() == columns) array = Doubles(array.reshape({py::ssize_t{1}, columns}));
    if (array.ndim() != 2 || array.shape(1) != columns)
        throw py::value_error(std::string(name) + ": shape " + shape_of(array) + ", needs (records, " +
                              std::to_string(columns) + "), one record in each row");
    check_finite(array, name, missing);
    return array;
}

Eigen::Map<const Eigen::MatrixXd> matrix(const Doubles& records) {
    return {records.data(), records.shape(1), records.shape(0)};
}

Eigen::Map<const Eigen::VectorXd> vector(const Doubles& numbers) {
    return {numbers.data(), numbers.size()};
}

std::span<const double> span(const Doubles& numbers) {
    return {numbers.data(), static_cast<std::size_t>(numbers.size())};
}

py::array_t<double> array(Eigen::MatrixXd&& matrix) {
    const py::ssize_t rows = matrix.rows();
    return owning(std::move(matrix), {matrix.cols(), rows}, {rows * width, width});
}

py::array_t<double> array(Eigen::VectorXd&& vector) {
    const py::ssize_t size = vector.size();
    return owning(std::move(vector), {size}, {width});
}

py::array_t<double> array(std::vector<double>&& vector) {
    const auto size = static_cast<py::ssize_t>(vector.size());
    return owning(std::move(vector), {size}, {width});
}

py::array_t<double> derivative_array(Eigen::MatrixXd&& matrix, py::ssize_t directions) {
    const py::ssize_t rows = matrix.rows();
    const py::ssize_t count = directions > 0 ? matrix.cols() / directions : 0;
    return owning(std::move(matrix), {count, rows, directions}, {rows * directions * width, width, rows * width});
}

py::array view(const Eigen::MatrixXd& matrix, py::handle owner) {
    return read_only(py::array_t<double>({matrix.cols(), matrix.rows()}, matrix.data(), owner));
}

py::array view(const Eigen::VectorXd& vector, py::handle owner) {
    return read_only(py::array_t<double>(vector.size(), vector.data(), owner));
}

py::array read_only(py::array array) {
    array.attr("setflags")(py::arg("write") = false);
    return array;
}

void bind_arrays(py::module_& module) {
    module.def(
        "_numbers", [](py::handle values, const std::string& name) { return doubles(values, name.c_str()); },
        py::arg("values"), py::arg("name"), "Real numbers as float64 in C order, by the rules of every argument.");
    module.def(
        "_finite_vector",
        [](py::handle values, const std::string& name, std::optional<py::ssize_t> size) {
            return finite_vector(values, name.c_str(), size);
        },
        py::arg("values"), py::arg("name"), py::arg("size") = py::none(), "The same, shape (size,), all finite.");
}

}  // namespace orbid::python
