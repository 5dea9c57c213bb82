#pragma once

#include <string>

#include "apps/computed_orbit.hpp"

namespace orbid::apps {

/// Computed orbits for people, on standard output: the starts of the job one by one (period, rotation, status, first
/// point, multipliers, closing error), what was found instead of those that did not converge, and what a search found
/// by period.
[[nodiscard]] std::string orbits_summary(const ComputedOrbits& orbits);

}  // namespace orbid::apps
