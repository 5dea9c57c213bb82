#pragma once

#include "apps/results/computed_orbit.hpp"
#include "apps/results/followed_branch.hpp"
#include "apps/stages/workspace.hpp"

namespace orbid::apps {

/// Follows the branches of the job's "continuation" from the listed orbit that it names. Stores them as branch.json,
/// branch.csv and branch.svg, which are reused when the fingerprint fits. Without a branch the message says why, and
/// there is no plot.
[[nodiscard]] FollowedBranches follow_job_branches(const Workspace& work, const ComputedOrbits& orbits);

/// Points as lists hold them: where no section says which points are meant, the first one stands for the orbit.
/// Jacobians are not stored.
void thin_out(const Job& job, std::vector<periodic::Branch>& branches);

}  // namespace orbid::apps
