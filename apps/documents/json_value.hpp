#pragma once

#include <concepts>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/json_document.hpp"

namespace orbid::apps {

/// A text is no JSON that can be taken in; what() = "3:17: /estimates/0: number overflow parsing '1e999'".
class JsonRefused : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// What parse_json() says of a text first, with its place; for one that it accepts, that it is not JSON.
[[nodiscard]] std::string json_refusal(std::string_view text);

/// A text as a value of nlohmann's library, which by itself lets through what later ends the program: nesting that
/// exhausts the stack.
///
/// @param comments  whether // and /* */ may stand in it, as in jobs.
/// @throws JsonRefused: syntax, numbers beyond the range of a double, more than `deepest_json` levels, no UTF-8.
template <class Json = nlohmann::json>
[[nodiscard]] Json json_value(std::string_view text, bool comments = false) {
    if (is_nested_too_deep(text)) throw JsonRefused(json_refusal(text));
    try {
        return Json::parse(text, nullptr, true, comments);
    } catch (const nlohmann::json::exception&) {
        throw JsonRefused(json_refusal(text));
    }
}

/// The same; a text that is refused gives a value that is discarded (`is_discarded()`).
template <class Json = nlohmann::json>
[[nodiscard]] Json json_value_or_discarded(std::string_view text, bool comments = false) {
    if (is_nested_too_deep(text)) return Json(nlohmann::json::value_t::discarded);
    return Json::parse(text, nullptr, false, comments);
}

/// A number as an integer. nlohmann's get() converts any number, also 0.5 and those beyond the range of the integer.
/// @throws Json::type_error  the value is no whole number of that range.
template <std::integral Integer, class Json>
[[nodiscard]] Integer whole_number(const Json& value) {
    const bool fits = value.is_number_unsigned()
                          ? std::in_range<Integer>(value.template get<std::uint64_t>())
                          : value.is_number_integer() && std::in_range<Integer>(value.template get<std::int64_t>());
    if (!fits) throw Json::type_error::create(302, "must be a whole number of its range", &value);
    return value.template get<Integer>();
}

/// A list of them.
template <std::integral Integer, class Json>
[[nodiscard]] std::vector<Integer> whole_numbers(const Json& list) {
    if (!list.is_array()) throw Json::type_error::create(302, "must be a list", &list);
    std::vector<Integer> numbers;
    for (const Json& value : list)
        numbers.push_back(whole_number<Integer>(value));
    return numbers;
}

}  // namespace orbid::apps
