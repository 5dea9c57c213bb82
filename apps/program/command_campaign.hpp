#pragma once

#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// orbid campaign: runs a campaign, or asks its journal.
[[nodiscard]] int run_campaign_command(const CommandCall& call);
/// What may stand for a campaign's file: what its journal is asked.
[[nodiscard]] std::vector<std::string> campaign_verbs();
[[nodiscard]] std::vector<std::string> engine_choices();
[[nodiscard]] std::vector<std::string> campaign_table_choices();

}  // namespace orbid::apps
