#include "apps/results/counted_noun.hpp"

#include <fmt/format.h>

namespace orbid::apps {

std::string counted(std::size_t count, std::string_view noun, std::string_view digits) {
    const std::string number = digits.empty() ? std::to_string(count) : std::string(digits);
    if (count == 1) return fmt::format("{} {}", number, noun);
    constexpr std::string_view vowels = "aeiou";
    const bool changes = noun.size() > 1 && noun.back() == 'y' && vowels.find(noun[noun.size() - 2]) == vowels.npos;
    return changes ? fmt::format("{} {}ies", number, noun.substr(0, noun.size() - 1))
                   : fmt::format("{} {}s", number, noun);
}

}  // namespace orbid::apps
