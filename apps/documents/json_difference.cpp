#include "apps/documents/json_difference.hpp"

#include <cstddef>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

std::string shortened(const std::string& text) {
    constexpr std::size_t longest = 100;  // a value can be a whole part of the job
    return text.size() <= longest ? text : text.substr(0, longest) + "...";
}

/// First place where two JSON values differ, in the order of sorted keys; empty when they are equal.
std::string difference_below(const nlohmann::json& stored, const nlohmann::json& wanted, const std::string& pointer,
                             const std::string& here) {
    if (stored == wanted) return "";
    if (stored.is_object() && wanted.is_object()) {
        nlohmann::json all = stored;
        all.update(wanted);
        for (const auto& item : all.items()) {
            const std::string at = pointer + "/" + item.key();
            if (!stored.contains(item.key()))
                return fmt::format("{} is absent there, {} {}", at, shortened(wanted[item.key()].dump()), here);
            if (!wanted.contains(item.key()))
                return fmt::format("{} is {} there, absent {}", at, shortened(stored[item.key()].dump()), here);
            std::string inside = difference_below(stored[item.key()], wanted[item.key()], at, here);
            if (!inside.empty()) return inside;
        }
    }
    if (stored.is_array() && wanted.is_array() && stored.size() == wanted.size()) {
        for (std::size_t i = 0; i < stored.size(); ++i) {
            std::string inside = difference_below(stored[i], wanted[i], pointer + "/" + std::to_string(i), here);
            if (!inside.empty()) return inside;
        }
    }
    return fmt::format("{} is {} there, {} {}", pointer, shortened(stored.dump()), shortened(wanted.dump()), here);
}

}  // namespace

std::string first_difference(const nlohmann::json& stored, const nlohmann::json& wanted, const std::string& here) {
    return difference_below(stored, wanted, "", here);
}

}  // namespace orbid::apps
