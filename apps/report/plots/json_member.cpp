#include "apps/report/plots/json_member.hpp"

#include <limits>

namespace orbid::apps::detail {

double number_of(const Json& value) {
    return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

double number_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() ? number_of(*found) : std::numeric_limits<double>::quiet_NaN();
}

std::string text_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

const Json& block_at(const Json& object, std::string_view key) {
    static const Json empty = Json::object();
    const auto found = object.find(key);
    return found != object.end() && found->is_structured() ? *found : empty;
}

const Json& block_at(const std::optional<Json>& object, std::string_view key) {
    return block_at(object ? &*object : nullptr, key);
}

const Json& block_at(const Json* object, std::string_view key) {
    static const Json none;
    return block_at(object == nullptr ? none : *object, key);
}

std::optional<std::array<double, 2>> ends_at(const Json& object, std::string_view key) {
    const Json& ends = block_at(object, key);
    if (!ends.is_array() || ends.size() != 2) return std::nullopt;
    return std::array{number_of(ends[0]), number_of(ends[1])};
}

double interval_end(const Json& entry, std::size_t end) {
    const auto ends = ends_at(entry, "interval95");
    return ends ? ends->at(end) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace orbid::apps::detail
