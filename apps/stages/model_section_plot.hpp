#pragma once

#include <optional>
#include <string>

#include "apps/job/job.hpp"
#include "apps/results/computed_orbit.hpp"

namespace orbid::apps {

/// Plot of the computed orbits' points in the model's section, over some thousand section points of its trajectories.
/// @return nothing without a section of two coordinates or more (models of one coordinate, autonomous models without a
///         section).
[[nodiscard]] std::optional<std::string> model_section_svg(const Job& job, const ComputedOrbits& orbits);

}  // namespace orbid::apps
