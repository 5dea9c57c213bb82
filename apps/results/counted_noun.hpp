#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace orbid::apps {

/// "1 trajectory", "3 trajectories": a number with a regular English noun.
/// @param digits  how the number is written; empty: plainly.
[[nodiscard]] std::string counted(std::size_t count, std::string_view noun, std::string_view digits = "");

}  // namespace orbid::apps
