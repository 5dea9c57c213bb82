#pragma once

#include <initializer_list>
#include <optional>
#include <span>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <Eigen/Core>

namespace orbid::python {

/// Numbers of float64 in C order, which the library reads in place.
using Doubles =
    pybind11::array_t<double, int{pybind11::array::c_style} | int{pybind11::detail::npy_api::NPY_ARRAY_ALIGNED_}>;

/// An argument as float64 in C order. An array of this form, even if read-only, is used without a copy. Other strides
/// and float16, float32 are copied; integers are converted if float64 holds them exactly.
///
/// @param name  of the argument, for messages.
/// @throws TypeError for None, bool, complex, long double, text and objects; ValueError for an integer beyond 2^53.
[[nodiscard]] Doubles doubles(pybind11::handle argument, const char* name);

/// The same, one-dimensional; a number is one entry. @param size  required where given. All entries finite.
/// @throws ValueError naming the shape, or the entry that is not finite.
[[nodiscard]] Doubles finite_vector(pybind11::handle argument, const char* name,
                                    std::optional<pybind11::ssize_t> size = std::nullopt);

/// The same, shape (records, columns); one-dimensional: one record. @param missing  nan is allowed.
[[nodiscard]] Doubles records(pybind11::handle argument, const char* name, pybind11::ssize_t columns,
                              bool missing = false);

/// The memory of records, shape (m, n) in C order, as the library's matrix (n, m): valid while the array exists.
[[nodiscard]] Eigen::Map<const Eigen::MatrixXd> matrix(const Doubles& records);
[[nodiscard]] Eigen::Map<const Eigen::VectorXd> vector(const Doubles& numbers);
[[nodiscard]] std::span<const double> span(const Doubles& numbers);

/// A matrix (n, m) as an array (m, n) of records that owns its memory, without a copy.
[[nodiscard]] pybind11::array_t<double> array(Eigen::MatrixXd&& matrix);
[[nodiscard]] pybind11::array_t<double> array(Eigen::VectorXd&& vector);
[[nodiscard]] pybind11::array_t<double> array(std::vector<double>&& vector);

/// A matrix (n, m d), columns [k d, (k + 1) d) of record k, as an array (m, n, d) that owns its memory: entry [k, i, j]
/// belongs to coordinate i and direction j. Nothing is copied, so the strides of its last two axes are exchanged.
[[nodiscard]] pybind11::array_t<double> derivative_array(Eigen::MatrixXd&& matrix, pybind11::ssize_t directions);

/// The same array, read-only: writing into a copy of an object's data would be lost.
[[nodiscard]] pybind11::array read_only(pybind11::array array);

/// The memory of a matrix (n, m) of `owner` as an array (m, n), which keeps the owner alive. Read-only.
[[nodiscard]] pybind11::array view(const Eigen::MatrixXd& matrix, pybind11::handle owner);
[[nodiscard]] pybind11::array view(const Eigen::VectorXd& vector, pybind11::handle owner);

}  // namespace orbid::python
