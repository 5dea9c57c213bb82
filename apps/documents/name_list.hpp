#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

[[nodiscard]] inline bool is_in(std::string_view name, const std::vector<std::string>& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace orbid::apps
