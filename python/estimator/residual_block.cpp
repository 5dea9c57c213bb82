
#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/estimator/python_residual.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

/// A matrix of the shape needed; values may be nan, derivatives of a row-major array are put into the library's order.
Eigen::MatrixXd shaped(py::handle value, Eigen::Index rows, Eigen::Index columns, const std::string& place) {
    const Doubles entries = doubles(value, place.c_str());
    if (entries.ndim() != 2 || entries.shape(0) != rows || entries.shape(1) != columns)
        throw py::value_error(place + ": shape " + std::string(py::str(entries.attr("shape"))) + ", needs (" +
                              std::to_string(rows) + ", " + std::to_string(columns) + ")");
    return matrix(entries).transpose();
}

Eigen::VectorXd sized(py::handle value, Eigen::Index size, const std::string& place) {
    const Doubles entries = doubles(value, place.c_str());
    if (entries.ndim() != 1 || entries.size() != size)
        throw py::value_error(place + ": shape " + std::string(py::str(entries.attr("shape"))) + ", needs (" +
                              std::to_string(size) + ",)");
    return vector(entries);
}

/// The number of a group by its number or name.
int group_of(py::handle value, const std::vector<estimator::Group>& groups, const std::string& place) {
    if (py::isinstance<py::str>(value)) {
        const auto name = value.cast<std::string>();
        for (std::size_t g = 0; g < groups.size(); ++g)
            if (groups[g].name == name) return static_cast<int>(g);
        throw py::value_error(place + ": there is no group '" + name + "'");
    }
    const long long number = whole_number(value, place);
    if (number < 0 || number >= static_cast<long long>(groups.size()))
        throw py::value_error(place + " = " + std::to_string(number) + ": there are " + std::to_string(groups.size()) +
                              " groups");
    return static_cast<int>(number);
}

}  // namespace

estimator::BlockValue block_value(py::handle answer, const estimator::BlockLayout& block, Eigen::Index next_latents,
                                  Eigen::Index parameters, bool derivatives, const std::string& where) {
    const auto records = static_cast<Eigen::Index>(block.group.size());
    NamedArguments given(where, answer);
    estimator::BlockValue value;
    const auto required = [&](const char* name) {
        py::object entry = given.find_value(name);
        if (!entry) throw py::type_error(where + ": '" + name + "' is missing");
        return entry;
    };
    value.e = sized(required("e"), records, given.place("e"));
    const bool linked = block.linked_from >= 0;
    if (block.constraints > 0) value.c = sized(required("c"), block.constraints, given.place("c"));
    if (derivatives) {
        const auto derivative = [&](const char* name, Eigen::Index rows, Eigen::Index columns) {
            return shaped(required(name), rows, columns, given.place(name));
        };
        value.e_theta = derivative("e_theta", records, parameters);
        value.e_z = block.latents > 0 ? derivative("e_z", records, block.latents) : Eigen::MatrixXd(records, 0);
        if (linked) value.e_next = derivative("e_next", records, next_latents);
        if (block.constraints > 0) {
            value.c_theta = derivative("c_theta", block.constraints, parameters);
            value.c_z = derivative("c_z", block.constraints, block.latents);
            if (block.next >= 0) value.c_next = derivative("c_next", block.constraints, next_latents);
        }
    }
    // Derivatives that are not asked for, or that this block has none of, may be there all the same.
    for (const char* name : {"c", "e_theta", "e_z", "e_next", "c_theta", "c_z", "c_next"})
        (void)given.find(name);
    given.finish();
    return value;
}

estimator::BlockLayout block_layout(py::handle description, const std::vector<estimator::Group>& groups,
                                    std::size_t number) {
    const std::string where = "layout(), block " + std::to_string(number);
    NamedArguments given(where, description);
    estimator::BlockLayout block;
    block.label = given.text("label", "block " + std::to_string(number));
    const py::object of_each = given.find_value("groups");
    const py::object of_all = given.find_value("group");
    const long long records = given.integer("records", -1, 0);
    if (of_each) {
        if (of_all || records >= 0) throw py::value_error(where + ": 'groups' stands for 'records' and 'group'");
        for (const py::handle item : of_each)
            block.group.push_back(group_of(item, groups, given.place("groups")));
    } else {
        if (records < 0) throw py::type_error(where + ": 'records' or 'groups' is missing");
        block.group.assign(static_cast<std::size_t>(records),
                           of_all ? group_of(of_all, groups, given.place("group")) : 0);
    }
    const auto count = static_cast<Eigen::Index>(block.group.size());
    const auto optional_vector = [&](const char* name, Eigen::Index size) {
        const Eigen::VectorXd values = given.vector(name);
        if (values.size() > 0 && values.size() != size)
            throw py::value_error(given.place(name) + ": " + std::to_string(values.size()) + " entries, needs " +
                                  std::to_string(size));
        return values;
    };
    given.take("shape", block.shape);
    block.deviation = optional_vector("deviation", count);
    block.observed = optional_vector("observed", count);
    given.take({{"latents", block.latents},
                {"constraints", block.constraints},
                {"linked_from", block.linked_from, -1},
                {"next", block.next, -1},
                {"constraint_size", block.constraint_size},
                {"active", block.active}});
    given.finish();
    return block;
}

}  // namespace orbid::python
