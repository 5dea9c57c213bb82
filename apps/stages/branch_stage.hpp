#pragma once

#include "apps/results/computed_orbit.hpp"
#include "apps/results/followed_branch.hpp"
#include "apps/stages/workspace.hpp"

namespace orbid::apps {

/// Follows the branches of the job's "continuation" from the orbit of the list that it names, and stores them as
/// branch.json, branch.csv and branch.svg. Taken from the folder when the fingerprint fits. Without a branch the
/// message says why, and there is no picture.
[[nodiscard]] FollowedBranches follow_job_branches(const Workspace& work, const ComputedOrbits& orbits);

}  // namespace orbid::apps
