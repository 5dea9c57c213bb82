#include "python/conversion/arguments.hpp"

#include <algorithm>

#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

template <class Item>
std::vector<std::string> names_of(std::span<const Item> items) {
    std::vector<std::string> names;
    for (const Item& item : items)
        names.emplace_back(item.name);
    return names;
}

/// What a name is not, and the nearest one there is.
std::string unknown(std::string_view name, const std::vector<std::string>& names, const std::string& what) {
    const std::string others = names.empty() ? "; there is none" : suggestion(name, names, ": ", "; there is");
    return "no " + what + " '" + std::string(name) + "'" + others;
}

}  // namespace

std::vector<std::string> parameter_names(const models::System& system) {
    return names_of(system.parameters());
}

std::vector<std::string> coordinate_names(const models::System& system) {
    return names_of(system.coordinates());
}

Eigen::Index index_of(std::string_view name, const std::vector<std::string>& names, const std::string& what) {
    const auto place = std::find(names.begin(), names.end(), name);
    if (place == names.end()) throw py::key_error(unknown(name, names, what));
    return place - names.begin();
}

Eigen::Index choice_of(std::string_view word, const std::vector<std::string>& words, const std::string& what) {
    const auto place = std::find(words.begin(), words.end(), word);
    if (place == words.end()) throw py::value_error(unknown(word, words, what));
    return place - words.begin();
}

Eigen::VectorXd parameter_values(const models::System& system, py::handle parameters) {
    Eigen::VectorXd theta = system.default_parameters();
    if (!parameters || parameters.is_none()) return theta;
    const auto table = system.parameters();
    if (py::isinstance<py::str>(parameters))
        throw py::type_error("parameters: text; a dict of names and values or an array is needed");
    if (py::hasattr(parameters, "items")) {
        const auto names = parameter_names(system);
        for (const py::handle item : parameters.attr("items")()) {
            const auto pair = py::reinterpret_borrow<py::tuple>(item);
            if (!py::isinstance<py::str>(pair[0])) throw py::type_error("parameters: names must be text");
            const auto name = pair[0].cast<std::string>();
            const Eigen::Index k = index_of(name, names, "parameter");
            theta[k] = *finite_vector(pair[1], ("parameters['" + name + "']").c_str(), 1).data();
        }
    } else {
        theta = vector(finite_vector(parameters, "parameters", theta.size()));
    }
    for (std::size_t k = 0; k < table.size(); ++k) {
        const double value = theta[static_cast<Eigen::Index>(k)];
        if (!models::contains(table[k].domain, value))
            throw py::value_error("parameters['" + std::string(table[k].name) + "'] = " + std::to_string(value) +
                                  ": must be " + std::string(models::rule(table[k].domain)));
    }
    return theta;
}

std::optional<std::vector<Eigen::Index>> free_parameters(const models::System& system, py::handle names) {
    if (!names || names.is_none() || (py::isinstance<py::bool_>(names) && !names.cast<bool>())) return std::nullopt;
    const auto known = parameter_names(system);
    std::vector<Eigen::Index> free;
    if (py::isinstance<py::bool_>(names)) {
        for (std::size_t k = 0; k < known.size(); ++k)
            free.push_back(static_cast<Eigen::Index>(k));
        return free;
    }
    if (py::isinstance<py::str>(names)) return std::vector{index_of(names.cast<std::string>(), known, "parameter")};
    for (const py::handle name : names) {
        if (!py::isinstance<py::str>(name)) throw py::type_error("sensitivities: names of parameters are needed");
        free.push_back(index_of(name.cast<std::string>(), known, "parameter"));
    }
    return free;
}

std::optional<models::Section> plane(const models::System& system, py::handle section) {
    if (!section || section.is_none()) return std::nullopt;
    NamedArguments given("section", section);
    models::Section plane;
    const std::string coordinate = given.has("coordinate") ? given.text("coordinate", "") : "";
    if (!coordinate.empty()) {
        if (given.has("normal") || given.has("offset"))
            throw py::value_error("section: either 'coordinate' and 'value' or 'normal' and 'offset'");
        plane.normal = Eigen::VectorXd::Zero(system.dimension());
        plane.normal[index_of(coordinate, coordinate_names(system), "coordinate")] = 1.0;
        plane.offset = given.required_number("value");
    } else {
        const py::object normal = given.find_value("normal");
        if (!normal) throw py::type_error("section: needs 'coordinate' and 'value', or 'normal' and 'offset'");
        plane.normal = vector(finite_vector(normal, "section: normal", system.dimension()));
        plane.offset = given.required_number("offset");
    }
    const double direction = given.optional_number("direction").value_or(plane.direction);
    plane.direction = direction > 0 ? 1 : -1;
    if (direction != plane.direction) throw py::value_error("section: direction: must be 1 or -1");
    given.finish();
    return plane;
}

models::FlowOptions flow_options(double rtol, double atol, std::size_t maximum_steps) {
    return {.relative_tolerance = rtol, .absolute_tolerance = atol, .maximum_steps = maximum_steps};
}

std::vector<double> phases(py::handle phase, Eigen::Index count) {
    const Doubles given = finite_vector(phase, "phase");
    if (given.size() == 1) return std::vector<double>(static_cast<std::size_t>(count), *given.data());
    if (given.size() != count)
        throw py::value_error("phase: " + std::to_string(given.size()) + " entries, needs one or " +
                              std::to_string(count));
    return {given.data(), given.data() + count};
}

std::vector<std::string> direction_names(const models::System& system, const std::vector<Eigen::Index>& free) {
    std::vector<std::string> names = coordinate_names(system);
    const auto parameters = parameter_names(system);
    for (const Eigen::Index k : free)
        names.push_back(parameters[static_cast<std::size_t>(k)]);
    return names;
}

}  // namespace orbid::python
