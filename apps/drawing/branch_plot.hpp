#pragma once

#include <optional>
#include <string>
#include <vector>

#include "models/definition/parameter.hpp"
#include "orbits/records/series.hpp"
#include "periodic/branches/branch.hpp"

namespace orbid::apps {

struct BranchPlotOptions {
    std::string title;                  ///< empty = "Branches of periodic orbits"
    std::optional<Eigen::Index> shown;  ///< coordinate of the points upwards; empty: the time T of the orbits
};

/// Bifurcation picture (SVG 1.1): the parameter to the right, one coordinate of the points of the section (or T)
/// upwards; stable orbits solid, unstable ones dashed, coloured by period; located doublings, folds, branch points and
/// Neimark-Sacker bifurcations marked; legend, axes with units. The same input gives the same bytes.
///
/// Lines are broken where an angle leaves (-pi, pi]. Points nearer than half a pixel to the last one drawn are left
/// out.
/// @throws std::invalid_argument when `shown` is no coordinate.
[[nodiscard]] std::string branches_svg(const std::vector<periodic::Branch>& branches,
                                       const models::Parameter& parameter,
                                       const std::vector<orbits::SeriesCoordinate>& coordinates,
                                       const BranchPlotOptions& options = {});

}  // namespace orbid::apps
