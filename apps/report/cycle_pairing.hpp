#pragma once

#include <cstddef>
#include <string>

#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

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
