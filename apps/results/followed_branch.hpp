#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "periodic/branches/branch.hpp"

namespace orbid::apps {

/// What the continuation of a job has led to.
struct FollowedBranches {
    std::string message;  ///< why there is no branch; empty otherwise
    std::vector<periodic::Branch> branches;
};

/// A place in a list of branches.
struct BranchPlace {
    std::size_t branch = 0;
    std::size_t point = 0;
};

/// The bifurcations of all branches, each once: the orbit that a branch begins with where it was switched to, and the
/// one it ends with where it meets another, are listed with the other branch alone.
[[nodiscard]] std::vector<BranchPlace> located_bifurcations(const std::vector<periodic::Branch>& branches);

/// The branch that was switched to at a place; none when no one was.
[[nodiscard]] std::vector<std::size_t> branches_from(const std::vector<periodic::Branch>& branches, BranchPlace place);

/// Cascades of period doublings: every doubling of a branch that did not begin at one itself, followed by the first
/// doubling of the branch that begins there, and so on. Cascades of one doubling are left out.
[[nodiscard]] std::vector<std::vector<BranchPlace>> doubling_cascades(const std::vector<periodic::Branch>& branches);

/// Period of a branch's orbits; the orbits that it shares with other branches at its ends may have half of it.
[[nodiscard]] int branch_period(const periodic::Branch& branch);

/// Multiplier nearest to the unit circle; nan without any.
[[nodiscard]] std::complex<double> critical_multiplier(const periodic::PeriodicOrbit& orbit);

}  // namespace orbid::apps
