#pragma once

#include <string>

#include "apps/estimation/estimate_strategy.hpp"

namespace orbid::apps {

/// Adds to the cycles of `input` what the estimate before points to, and stores harvested_cycles.json. What there is to
/// say is said.
/// @return why nothing was added; empty: there are more cycles now.
[[nodiscard]] std::string harvest_cycles(StageInput& input, const StageRun& before);

/// Stores the cycles of `input` as harvested_cycles.json.
void store_harvest(const StageInput& input);

}  // namespace orbid::apps
