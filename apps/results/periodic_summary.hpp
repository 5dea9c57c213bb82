#pragma once

#include <string>

#include "apps/results/computed_orbit.hpp"
#include "apps/results/followed_branch.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::apps {

/// Computed orbits for people, on standard output: the starts of the job one by one (period, rotation, status, first
/// point, multipliers, closing error), what was found instead of those that did not converge, and what a search found
/// by period.
[[nodiscard]] std::string orbits_summary(const ComputedOrbits& orbits);

/// Branches for people: each with where it begins, how far it goes and why it ends; the located bifurcations with
/// value, error and critical multiplier; the cascades of period doublings with the ratios of their intervals.
[[nodiscard]] std::string branches_summary(const FollowedBranches& followed, const models::Parameter& parameter);

}  // namespace orbid::apps
