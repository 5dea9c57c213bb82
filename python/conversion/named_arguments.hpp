#pragma once

#include <algorithm>
#include <functional>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
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

    /// Whole numbers, each at least `least`; empty when not given.
    [[nodiscard]] std::vector<long long> integers(const char* name, long long least);
    /// The value that the text stands for, `otherwise` when not given. @throws ValueError naming the words.
    template <class Value>
    [[nodiscard]] Value word(const char* name, const std::vector<std::pair<std::string, Value>>& words,
                             const Value& otherwise) {
        std::vector<std::string> known;
        std::size_t standard = 0;
        for (const auto& [text, value] : words) {
            if (value == otherwise) standard = known.size();
            known.push_back(text);
        }
        return words[choice(name, known, standard)].second;
    }

    /// Sets an option by its keyword, in the way of its type; not given, it keeps its default. Whole numbers are at
    /// least `least`; vectors, texts and what is optional may be None.
    template <class Option>
    void take(const char* name, Option& option, long long least = 0);
    /// The same for several.
    struct Keyword {
        template <class Option>
        Keyword(const char* name, Option& option, long long least = 0)
            : take([=, &option](NamedArguments& given) { given.take(name, option, least); }) {}
        std::function<void(NamedArguments&)> take;
    };
    void take(std::initializer_list<Keyword> keywords) {
        for (const Keyword& keyword : keywords)
            keyword.take(*this);
    }

    /// @throws TypeError for names never requested.
    void finish() const;

    [[nodiscard]] std::string place(const char* name) const { return where_ + ": " + name; }

private:
    std::string where_;
    pybind11::dict given_;
    std::vector<std::string> asked_;
};

template <class Option>
void NamedArguments::take(const char* name, Option& option, long long least) {
    if constexpr (std::is_same_v<Option, bool>) {
        option = flag(name, option);
    } else if constexpr (std::is_same_v<Option, double>) {
        option = number(name, option);
    } else if constexpr (std::is_integral_v<Option>) {
        option = static_cast<Option>(integer(name, static_cast<long long>(option), least));
    } else if constexpr (std::is_same_v<Option, std::string>) {
        option = text(name, option);
    } else if constexpr (requires { option.has_value(); }) {
        if (has(name)) take(name, option.emplace(), least);
    } else if (!has(name)) {
        return;
    } else if constexpr (std::is_same_v<Option, std::vector<std::string>>) {
        option = texts(name);
    } else if constexpr (std::is_same_v<Option, Eigen::MatrixXd>) {
        option = matrix(name);
    } else if constexpr (std::is_same_v<typename Option::value_type, double>) {
        const Eigen::VectorXd values = vector(name);
        option.resize(static_cast<decltype(option.size())>(values.size()));
        std::copy(values.begin(), values.end(), option.begin());
    } else {
        const std::vector<long long> values = integers(name, least);
        option.assign(values.begin(), values.end());
    }
}

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

/// A whole number in [least, 2^53] written as one: no float, no bool. @throws TypeError, ValueError naming `place`.
[[nodiscard]] long long whole_number(pybind11::handle value, const std::string& place,
                                     long long least = std::numeric_limits<long long>::min());

/// A number that is finite. @throws TypeError, ValueError naming `place`.
[[nodiscard]] double finite_number(pybind11::handle value, const std::string& place);

/// A matrix as written, shape (rows, columns): a copy in the library's order. @throws TypeError, ValueError.
[[nodiscard]] Eigen::MatrixXd written_matrix(pybind11::handle value, const std::string& place);

/// Texts; one text counts as a list of one. @throws TypeError naming `place`.
[[nodiscard]] std::vector<std::string> text_list(pybind11::handle value, const std::string& place);

}  // namespace orbid::python
