#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <pybind11/pybind11.h>
#include <Eigen/Core>

namespace orbid::python {

/// Values by name, from keyword arguments or a dict. Each is requested once; a name never requested is an error that
/// gives it and the nearest known one.
class NamedArguments {
public:
    /// @param where  begins every message: "estimate", "group 'phi'".
    /// @throws TypeError unless `given` is a mapping from text.
    NamedArguments(std::string where, pybind11::handle given);

    /// The value, None included; an empty handle if not given.
    [[nodiscard]] pybind11::object find(const char* name);
    /// The same, with None as not given.
    [[nodiscard]] pybind11::object find_value(const char* name);
    /// Whether there is a value other than None.
    [[nodiscard]] bool has(const char* name) { return bool(find_value(name)); }

    /// A number. Integers are accepted if float64 holds them exactly; bool and text are not.
    [[nodiscard]] double number(const char* name, double otherwise);
    [[nodiscard]] double required_number(const char* name);
    [[nodiscard]] std::optional<double> optional_number(const char* name);
    /// A whole number in [least, 2^53]. @throws TypeError for a float, ValueError below `least`.
    [[nodiscard]] long long integer(const char* name, long long otherwise, long long least);
    /// The same of the type of `otherwise`.
    template <class Whole>
    [[nodiscard]] Whole whole(const char* name, Whole otherwise, long long least) {
        return static_cast<Whole>(integer(name, static_cast<long long>(otherwise), least));
    }
    [[nodiscard]] bool flag(const char* name, bool otherwise);
    [[nodiscard]] std::string text(const char* name, const std::string& otherwise);
    /// Texts; one text counts as a list of one.
    [[nodiscard]] std::vector<std::string> texts(const char* name);
    /// Position of the text among the choices. @throws ValueError naming them.
    [[nodiscard]] std::size_t choice(const char* name, const std::vector<std::string>& choices,
                                     std::size_t otherwise = 0);
    /// Numbers, all finite; empty when not given.
    [[nodiscard]] Eigen::VectorXd vector(const char* name);
    /// A square or other matrix as written, row after row, all finite; empty when not given.
    [[nodiscard]] Eigen::MatrixXd matrix(const char* name);

    /// @throws TypeError for names never requested.
    void finish() const;

    [[nodiscard]] std::string place(const char* name) const { return where_ + ": " + name; }

private:
    std::string where_;
    pybind11::dict given_;
    std::vector<std::string> asked_;
};

/// "did you mean 'x'?" after its introduction where a known name is near, otherwise all of them after theirs.
[[nodiscard]] std::string suggestion(std::string_view name, const std::vector<std::string>& known,
                                     const char* before_nearest, const char* before_all);

/// A mapping from text as a dict: the one given, or a copy of another kind of mapping.
/// @throws TypeError naming `where`, for anything else and for a key that is not text.
[[nodiscard]] pybind11::dict mapping(pybind11::handle given, const std::string& where);
/// Whether it is a dict or another mapping.
[[nodiscard]] bool is_mapping(pybind11::handle given);
/// Whether it is a list or another sequence, but text.
[[nodiscard]] bool is_list(pybind11::handle given);

/// A whole number written as one: no float, no bool. @throws TypeError naming `place`.
[[nodiscard]] long long whole_number(pybind11::handle value, const std::string& place);

/// A number that is finite. @throws TypeError, ValueError naming `place`.
[[nodiscard]] double finite_number(pybind11::handle value, const std::string& place);

/// A matrix as written, shape (rows, columns): a copy in the library's order. @throws TypeError, ValueError.
[[nodiscard]] Eigen::MatrixXd written_matrix(pybind11::handle value, const std::string& place);

/// Texts; one text counts as a list of one. @throws TypeError naming `place`.
[[nodiscard]] std::vector<std::string> text_list(pybind11::handle value, const std::string& place);

}  // namespace orbid::python
