#pragma once

#include <optional>

#include "apps/results/computed_orbit.hpp"
#include "apps/stages/workspace.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

namespace orbid::apps {

/// Computes the periodic orbits that the job's "periodic" block starts or searches for, at the model's parameters, with
/// sensitivities to those asked for, and stores them as orbits.json: the starts in their order, then what the search
/// found. Each says how it ended. Taken from the folder when its fingerprint fits.
///
/// Interrupted: those not yet computed say so; the file carries no fingerprint then, so that the next run starts anew.
[[nodiscard]] ComputedOrbits compute_orbits(const Workspace& work);

/// The plane that orbits of an autonomous model cross; none without one.
[[nodiscard]] std::optional<models::Section> job_section(const Job& job);

/// An orbit of the list as a start: its points, or the state and the time of a flow that has no section.
[[nodiscard]] periodic::StartingSolution starting_solution(const Job& job, const periodic::PeriodicOrbit& orbit);

}  // namespace orbid::apps
