#pragma once

#include <string>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// Adds cycles found with the previous estimate to those of `input` and tells the observer of them and of remarks.
/// @return why nothing was added; empty: cycles were added.
[[nodiscard]] std::string harvest_cycles(StageInput& input, const StageRun& before);

}  // namespace orbid::identification
