#pragma once

#include <string>
#include <string_view>

#include "models/system/system.hpp"

namespace orbid::apps {

/// The blocks "section" (autonomous models) and "periodic" of a starting job, with comments. The start of the orbit is
/// the nearest return of a short simulation with the default parameters.
///
/// @param task  "periodic", "search" or "continuation".
[[nodiscard]] std::string starting_periodic_block(const models::System& system, std::string_view task);

}  // namespace orbid::apps
