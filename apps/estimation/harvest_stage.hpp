#pragma once

#include <string>

#include "apps/estimation/strategy_stage.hpp"

namespace orbid::apps {

/// Adds cycles found with the previous estimate to those of `input`, and stores harvested_cycles.json. Reports remarks.
/// @return why nothing was added; empty: cycles were added.
[[nodiscard]] std::string harvest_cycles(StageInput& input, const StageRun& before);

/// Stores the cycles of `input` as harvested_cycles.json.
void store_harvest(const StageInput& input);

}  // namespace orbid::apps
