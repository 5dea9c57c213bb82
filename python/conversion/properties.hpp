#pragma once

#include <complex>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "python/conversion/arrays.hpp"

namespace orbid::python {

/// Getters of properties. The name of an enumerator:
template <class Object, class Member>
[[nodiscard]] auto name_of(Member Object::*which) {
    return [which](const Object& one) { return std::string(name(one.*which)); };
}

/// A matrix or vector of an object in place, see view().
template <class Object, class Member>
[[nodiscard]] auto memory_of(Member Object::*which) {
    return [which](const pybind11::object& self) { return view(self.cast<const Object&>().*which, self); };
}
template <class Object>
[[nodiscard]] auto memory_of(std::vector<std::complex<double>> Object::*which) {
    return [which](const pybind11::object& self) {
        const std::vector<std::complex<double>>& values = self.cast<const Object&>().*which;
        return read_only(pybind11::array_t<std::complex<double>>(static_cast<pybind11::ssize_t>(values.size()),
                                                                 values.data(), self));
    };
}
/// A matrix of an object in place as it is written, shape (rows, columns).
template <class Object>
[[nodiscard]] auto written_memory_of(Eigen::MatrixXd Object::*which) {
    return [which](const pybind11::object& self) -> pybind11::object {
        return view(self.cast<const Object&>().*which, self).attr("T");
    };
}

/// What `make` returns for each of the items, as a list.
template <class Items, class Make>
[[nodiscard]] pybind11::list listed(const Items& items, const Make& make) {
    pybind11::list list;
    for (const auto& item : items)
        list.append(make(item));
    return list;
}

/// The same as a dict by the name of each item.
template <class Items, class Name, class Make>
[[nodiscard]] pybind11::dict by_name(const Items& items, Name name, const Make& make) {
    pybind11::dict dict;
    for (const auto& item : items)
        dict[pybind11::str(item.*name)] = make(item);
    return dict;
}

/// What `compute` returns, computed without the lock of the interpreter.
template <class Compute>
[[nodiscard]] auto unlocked(const Compute& compute) {
    const pybind11::gil_scoped_release released;
    return compute();
}

}  // namespace orbid::python
