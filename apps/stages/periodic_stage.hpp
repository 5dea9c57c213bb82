#pragma once

#include <optional>

#include "apps/results/computed_orbit.hpp"
#include "apps/stages/workspace.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

namespace orbid::apps {

/// Computes the periodic orbits that the job's "periodic" block starts or searches for, at the model's parameters, with
/// the requested sensitivities. Stores them as orbits.json: the starts in order, then the orbits of the search, each
/// with its status. Reused from the folder when its fingerprint fits.
///
/// When interrupted, orbits not yet computed say so. The file then has no fingerprint, so that the next run starts
/// anew.
[[nodiscard]] ComputedOrbits compute_orbits(const Workspace& work);

/// The plane that orbits of an autonomous model cross, if any.
[[nodiscard]] std::optional<models::Section> job_section(const Job& job);

/// An orbit of the list as a start: its points, or state and time for a flow without a section.
[[nodiscard]] periodic::StartingSolution starting_solution(const Job& job, const periodic::PeriodicOrbit& orbit);

}  // namespace orbid::apps
