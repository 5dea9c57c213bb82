#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "apps/results/cycle_file.hpp"
#include "apps/results/followed_branch.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::apps {

/// Content of branch.json, format orbid-branches/1: the head of orbits.json, `parameter` (name, unit, range),
/// `message` (why there is no branch, or null), `branches` and `cascades` (doublings as [branch, point], their values,
/// errors and the ratios of their intervals). Of a branch: `origin` ([branch, point] it was switched to at, or null),
/// `ends` (why it ended, before the first and after the last point), `points`; of a point `parameter`, `arclength`,
/// `period`, `rotation`, `time` [s], `points` (one list of coordinates per period), `multipliers`, `unstable`,
/// `bifurcation` (null on ordinary points), `parameter_error` (of located bifurcations, else null), `frequency` [Hz]
/// (1 / time) and `amplitude` (`max`, `min`, `mean`, `half_range`, `rms` of the coordinates, or null). Where there are
/// some: `readings` (names and units of formulas that follow the coordinates in each amplitude), `piece` of each branch
/// (where this piece of the one branch was followed from), and `measured` (motions with `label`, `parameter`, `used`,
/// `unstable`, and of each measure `observed`, `predicted`, `sd`, `unit`).
[[nodiscard]] std::string branches_text(const CycleFileHead& head, const models::Parameter& parameter, double lower,
                                        double upper, const FollowedBranches& followed);

/// Columns of a table of branches that are the same for all points of an orbit.
struct FurtherColumns {
    std::string header;                           ///< each name with a comma before it
    std::vector<std::vector<std::string>> cells;  ///< by branch and point, likewise
};

/// The same as a table, one line per point of the section: branch, point, the parameter, arclength, period, time,
/// unstable, bifurcation, the largest multiplier, which point of the orbit, its coordinates, the frequency, the
/// amplitude of each coordinate and reading, and the piece where there are some.
/// @param further  columns behind these
[[nodiscard]] std::string branches_csv(const CycleFileHead& head, const models::Parameter& parameter,
                                       const FollowedBranches& followed, const FurtherColumns& further = {});

/// What a stored branch.json holds, without Jacobians; and its fingerprint.
struct StoredBranches {
    FollowedBranches followed;
    std::string fingerprint;  ///< as text; empty: none
};

/// @return nothing when the text is no such file.
[[nodiscard]] std::optional<StoredBranches> stored_branches(std::string_view text);

}  // namespace orbid::apps
