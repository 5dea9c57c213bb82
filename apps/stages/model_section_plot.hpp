#pragma once

#include <optional>
#include <string>

#include "apps/job/job.hpp"
#include "apps/results/computed_orbit.hpp"

namespace orbid::apps {

/// Picture of the points of the computed orbits in the model's section, over some thousand points of its own
/// trajectories there: see section_svg().
/// @return nothing where there is no section of two coordinates or more (models of one coordinate, autonomous models
///         without a section).
[[nodiscard]] std::optional<std::string> model_section_svg(const Job& job, const ComputedOrbits& orbits);

}  // namespace orbid::apps
