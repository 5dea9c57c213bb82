#include "apps/documents/json_value.hpp"

#include <fmt/format.h>

namespace orbid::apps {

std::string json_refusal(std::string_view text) {
    const JsonDocument document = parse_json(text);
    if (document.problems.empty()) return "1:1: is not JSON";
    const Problem& first = document.problems.front();
    return fmt::format("{}:{}: {}{}{}", first.place.line, first.place.column, first.pointer,
                       first.pointer.empty() ? "" : ": ", first.rule);
}

}  // namespace orbid::apps
