#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// Kinds of campaigns, in the order of their reference page.
[[nodiscard]] std::vector<std::string> starting_campaign_kinds();

/// A commented campaign that takes seconds. Where it needs a run or records, its comments hold the commands that make
/// them; all others run unchanged.
/// @throws std::invalid_argument for an unknown kind.
[[nodiscard]] std::string starting_campaign(std::string_view kind);

}  // namespace orbid::apps
