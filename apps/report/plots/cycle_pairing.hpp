#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// Members of two lists, and how far they are apart.
struct Pairing {
    double distance;
    std::size_t first;
    std::size_t second;
};

/// One to one, nearest first: a member that has a partner takes no other. Of pairs equally near the first one counts.
[[nodiscard]] std::vector<Pairing> nearest_pairs(std::vector<Pairing> candidates);

/// The cycles that two lists have in common, by period.
struct MatchedCycles {
    std::string table;       ///< period, cycles of either list, those in both, median distance; empty: not comparable
    std::size_t common = 0;  ///< cycles in both
};

/// Cycles of both lists, matched one to one, nearest first, whatever point a list begins with.
/// @param run            whose model tells which coordinates are angles.
/// @param first, second  in the format orbid-cycles/1; orbits that did not converge are left out.
/// @return an empty table when the lists have different coordinates.
[[nodiscard]] MatchedCycles matched_cycles(const StoredRun& run, const StoredRun::Json& first,
                                           const StoredRun::Json& second);

}  // namespace orbid::apps
