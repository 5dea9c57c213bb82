#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::orbits {

/// The known name that a misspelt one most likely means: fewest single-letter insertions, deletions and replacements,
/// ignoring case.
///
/// @return nothing when every known name needs more than a third of the letters changed (at least one, two from four
///         letters on): a suggestion would mislead. Nothing either for names of more than
///         200 characters.
[[nodiscard]] std::optional<std::string> nearest_name(std::string_view name, const std::vector<std::string>& known);

}  // namespace orbid::orbits
