#include "apps/report/plots/json_member.hpp"

#include <limits>

namespace orbid::apps::detail {

double number_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_number() ? found->get<double>()
                                                       : std::numeric_limits<double>::quiet_NaN();
}

std::string text_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

const Json* filled(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_structured() && !found->empty() ? &*found : nullptr;
}

double interval_end(const Json& entry, std::size_t end) {
    const Json* ends = filled(entry, "interval95");
    return ends != nullptr && ends->size() == 2 && (*ends)[end].is_number() ? (*ends)[end].get<double>()
                                                                            : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace orbid::apps::detail
