#include "python/conversion/named_arguments.hpp"

#include <algorithm>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

std::string type_name(py::handle value) {
    return py::str(py::type::handle_of(value).attr("__name__"));
}

[[noreturn]] void wrong_type(const std::string& place, py::handle value, const char* wanted) {
    throw py::type_error(place + " is " + (value.is_none() ? "None" : "of type " + type_name(value)) + ", needs " +
                         wanted);
}

std::string nearest(const std::string& name, const std::vector<std::string>& known) {
    return known.empty() ? "" : suggestion(name, known, ", ", "; known are");
}

}  // namespace

std::string suggestion(std::string_view name, const std::vector<std::string>& known, const char* before_nearest,
                       const char* before_all) {
    const auto near =
        py::module_::import("difflib").attr("get_close_matches")(name, known, 1).cast<std::vector<std::string>>();
    if (!near.empty()) return before_nearest + ("did you mean '" + near.front()) + "'?";
    std::string all = before_all;
    for (const std::string& one : known)
        all += (&one == &known.front() ? " '" : ", '") + one + "'";
    return all;
}

bool is_mapping(py::handle given) {
    return given && (py::isinstance<py::dict>(given) || PyMapping_Check(given.ptr()) != 0) &&
           py::hasattr(given, "keys");
}

bool is_list(py::handle given) {
    return py::isinstance<py::sequence>(given) && !py::isinstance<py::str>(given);
}

py::dict mapping(py::handle given, const std::string& where) {
    if (!is_mapping(given))
        throw py::type_error(where + " is " +
                             (!given || given.is_none() ? std::string("None") : "of type " + type_name(given)) +
                             ", needs a dict");
    const auto dict = py::isinstance<py::dict>(given) ? py::reinterpret_borrow<py::dict>(given)
                                                      : py::dict(py::reinterpret_borrow<py::object>(given));
    for (const auto& [key, value] : dict)
        if (!py::isinstance<py::str>(key)) throw py::type_error(where + ": a key is no text");
    return dict;
}

long long whole_number(py::handle value, const std::string& place, long long least) {
    // Python's own integers and NumPy's have __index__; a float has none, whatever its value.
    if (py::isinstance<py::bool_>(value) || !PyIndex_Check(value.ptr()))
        wrong_type(place, value, "a whole number (int)");
    const auto index = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
    if (!index) throw py::error_already_set();
    int overflow = 0;
    const long long whole = PyLong_AsLongLongAndOverflow(index.ptr(), &overflow);
    constexpr long long most = 1LL << 53;
    if (overflow != 0 || whole > most)
        throw py::value_error(place + " = " + std::string(py::str(index)) + " is out of range");
    if (whole < least)
        throw py::value_error(place + " = " + std::to_string(whole) + ", must be at least " + std::to_string(least));
    return whole;
}

double finite_number(py::handle value, const std::string& place) {
    if (value.is_none() || py::isinstance<py::str>(value)) wrong_type(place, value, "a number");
    return *finite_vector(value, place.c_str(), 1).data();
}

Eigen::MatrixXd written_matrix(py::handle value, const std::string& place) {
    const Doubles entries = doubles(value, place.c_str());
    if (entries.ndim() != 2)
        throw py::value_error(place + ": shape " + std::string(py::str(entries.attr("shape"))) +
                              ", needs two dimensions");
    const Doubles checked = records(entries, place.c_str(), entries.shape(1));
    return matrix(checked).transpose();
}

std::vector<std::string> text_list(py::handle value, const std::string& place) {
    if (py::isinstance<py::str>(value)) return {value.cast<std::string>()};
    if (value.is_none() || !py::isinstance<py::iterable>(value)) wrong_type(place, value, "a list of texts");
    std::vector<std::string> texts;
    for (const py::handle item : value) {
        if (!py::isinstance<py::str>(item)) wrong_type(place, item, "text in every place");
        texts.push_back(item.cast<std::string>());
    }
    return texts;
}

NamedArguments::NamedArguments(std::string where, py::handle given) : where_(std::move(where)) {
    given_ = mapping(given, where_);
}

py::object NamedArguments::find(const char* name) {
    asked_.emplace_back(name);
    if (!given_.contains(name)) return {};
    return given_[name];
}

py::object NamedArguments::find_value(const char* name) {
    const py::object value = find(name);
    return value && value.is_none() ? py::object() : value;
}

double NamedArguments::number(const char* name, double otherwise) {
    const py::object value = find(name);
    return value ? finite_number(value, place(name)) : otherwise;
}

double NamedArguments::required_number(const char* name) {
    const py::object value = find(name);
    if (!value) throw py::type_error(where_ + ": '" + name + "' is missing");
    return finite_number(value, place(name));
}

std::optional<double> NamedArguments::optional_number(const char* name) {
    const py::object value = find_value(name);
    if (!value) return std::nullopt;
    return finite_number(value, place(name));
}

long long NamedArguments::integer(const char* name, long long otherwise, long long least) {
    const py::object value = find(name);
    return value ? whole_number(value, place(name), least) : otherwise;
}

std::vector<long long> NamedArguments::integers(const char* name, long long least) {
    const py::object value = find_value(name);
    std::vector<long long> numbers;
    if (!value) return numbers;
    if (!py::isinstance<py::iterable>(value) || py::isinstance<py::str>(value))
        wrong_type(place(name), value, "a list of whole numbers");
    for (const py::handle item : value)
        numbers.push_back(whole_number(item, place(name), least));
    return numbers;
}

bool NamedArguments::flag(const char* name, bool otherwise) {
    const py::object value = find(name);
    if (!value) return otherwise;
    if (!py::isinstance<py::bool_>(value)) wrong_type(place(name), value, "True or False");
    return value.cast<bool>();
}

std::string NamedArguments::text(const char* name, const std::string& otherwise) {
    const py::object value = find(name);
    if (!value) return otherwise;
    if (!py::isinstance<py::str>(value)) wrong_type(place(name), value, "text");
    return value.cast<std::string>();
}

std::vector<std::string> NamedArguments::texts(const char* name) {
    const py::object value = find_value(name);
    return value ? text_list(value, place(name)) : std::vector<std::string>{};
}

std::size_t NamedArguments::choice(const char* name, const std::vector<std::string>& choices, std::size_t otherwise) {
    const std::string chosen = text(name, choices[otherwise]);
    const auto found = std::find(choices.begin(), choices.end(), chosen);
    if (found == choices.end()) throw py::value_error(place(name) + " = '" + chosen + "'" + nearest(chosen, choices));
    return static_cast<std::size_t>(found - choices.begin());
}

Eigen::VectorXd NamedArguments::vector(const char* name) {
    const py::object value = find_value(name);
    if (!value) return {};
    const Doubles numbers = finite_vector(value, place(name).c_str());
    return python::vector(numbers);
}

Eigen::MatrixXd NamedArguments::matrix(const char* name) {
    const py::object value = find_value(name);
    return value ? written_matrix(value, place(name)) : Eigen::MatrixXd();
}

void NamedArguments::finish() const {
    for (const auto& [key, value] : given_) {
        const auto name = key.cast<std::string>();
        if (std::find(asked_.begin(), asked_.end(), name) == asked_.end())
            throw py::type_error(where_ + ": unknown '" + name + "'" + nearest(name, asked_));
    }
}

}  // namespace orbid::python
