#pragma once

#include <vector>

#include "apps/workspace.hpp"
#include "periodic/orbit.hpp"

namespace orbid::apps {

/// Computes the periodic orbits that the job's "periodic" block starts, at the model's parameters, with sensitivities
/// to all of them, and stores them as orbits.json. In the order of the starts; each says how it ended.
[[nodiscard]] std::vector<periodic::PeriodicOrbit> compute_orbits(const Workspace& work);

}  // namespace orbid::apps
