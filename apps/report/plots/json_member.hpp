#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

namespace orbid::apps::detail {

using Json = nlohmann::ordered_json;

/// A number; nan where it is null or something else.
[[nodiscard]] double number_of(const Json& value);
/// A member of an object as a number: nan where it is absent, null or no number.
[[nodiscard]] double number_at(const Json& object, std::string_view key);
/// As text; empty where it is absent, null or no text.
[[nodiscard]] std::string text_at(const Json& object, std::string_view key);
/// A member that is an object or a list; an empty object where it is absent or something else.
[[nodiscard]] const Json& block_at(const Json& object, std::string_view key);
/// The same of an object that may not be there.
[[nodiscard]] const Json& block_at(const std::optional<Json>& object, std::string_view key);
[[nodiscard]] const Json& block_at(const Json* object, std::string_view key);

/// Both ends of an interval, nan where one is open; nothing unless it is a list of two.
[[nodiscard]] std::optional<std::array<double, 2>> ends_at(const Json& object, std::string_view key);

/// An end of "interval95", 0 or 1; nan where it is not known.
[[nodiscard]] double interval_end(const Json& entry, std::size_t end);

}  // namespace orbid::apps::detail
