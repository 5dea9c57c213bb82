#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <pybind11/pybind11.h>
#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::python {

/// The full parameter vector of a system: the defaults with the values of a dict, or all values from an array.
/// @param parameters  None, a mapping from names to numbers, or q numbers.
/// @throws KeyError for an unknown name, with the nearest one; ValueError for values outside their domain.
[[nodiscard]] Eigen::VectorXd parameter_values(const models::System& system, pybind11::handle parameters);

/// Indices of the parameters for derivatives: names, one name, or True for all of the model's.
/// @return nothing for None and False.
/// @throws KeyError for an unknown name, with the nearest one.
[[nodiscard]] std::optional<std::vector<Eigen::Index>> free_parameters(const models::System& system,
                                                                       pybind11::handle names);

/// The index of the name. @throws KeyError naming `what` and the nearest name.
[[nodiscard]] Eigen::Index index_of(std::string_view name, const std::vector<std::string>& names,
                                    const std::string& what);

/// The same for the words of an option. @throws ValueError.
[[nodiscard]] Eigen::Index choice_of(std::string_view word, const std::vector<std::string>& words,
                                     const std::string& what);

[[nodiscard]] std::vector<std::string> parameter_names(const models::System& system);
[[nodiscard]] std::vector<std::string> coordinate_names(const models::System& system);

/// A section as in a job, {"coordinate": "z", "value": 27, "direction": -1}, or {"normal": [..], "offset": 1.0};
/// nothing for None.
/// @throws KeyError, ValueError naming the key.
[[nodiscard]] std::optional<models::Section> plane(const models::System& system, pybind11::handle section);

/// Tolerances of a flow, checked by the library.
[[nodiscard]] models::FlowOptions flow_options(double rtol, double atol, std::size_t maximum_steps);

/// Phases of `count` states: one number for all, or one each.
[[nodiscard]] std::vector<double> phases(pybind11::handle phase, Eigen::Index count);

/// Names of the directions of sensitivities: the coordinates of the start, then the free parameters.
[[nodiscard]] std::vector<std::string> direction_names(const models::System& system,
                                                       const std::vector<Eigen::Index>& free);

}  // namespace orbid::python
