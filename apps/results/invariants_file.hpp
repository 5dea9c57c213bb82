#pragma once

#include <string>

#include "orbits/invariants/invariants.hpp"

namespace orbid::apps {

/// Content of invariants.json, format orbid-invariants/1: `cycle_expansion` (or why there is none), `lyapunov`,
/// `correlation`. Undefined numbers are null.
[[nodiscard]] std::string invariants_text(const orbits::Invariants& invariants);

/// The same as tables for the terminal.
[[nodiscard]] std::string invariants_summary(const orbits::Invariants& invariants);

}  // namespace orbid::apps
