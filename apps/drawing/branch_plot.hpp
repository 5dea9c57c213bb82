#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "orbits/records/series.hpp"
#include "periodic/branches/branch.hpp"

namespace orbid::apps {

/// What a picture of branches shows.
struct BranchPicture {
    orbits::SeriesCoordinate parameter;  ///< to the right
    std::optional<Eigen::Index> shown;   ///< coordinate of the points upwards; empty: the time T of the orbits
    orbits::SeriesCoordinate coordinate{"T", "s", false};  ///< name and unit of what is shown upwards
    std::string title;                                     ///< for those who do not see it
};

/// Branches as a chart: the parameter to the right, one coordinate of the points of the section (or T) upwards; stable
/// orbits solid, unstable ones dashed, coloured by period; located doublings, folds, branch points and Neimark-Sacker
/// bifurcations marked. Lines are broken where an angle leaves (-pi, pi].
[[nodiscard]] Chart branch_chart(const std::vector<periodic::Branch>& branches, const BranchPicture& picture);

}  // namespace orbid::apps
