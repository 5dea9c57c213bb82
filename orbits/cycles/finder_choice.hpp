#pragma once

#include <memory>

#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Refuses invalid options of a search, naming the option, its value and the rule.
/// @param dimension  coordinates of the series.
/// @throws std::invalid_argument
void check_search(const CycleSearchOptions& options, Eigen::Index dimension);

/// The method of fitting the map that the options name or, with Method::automatic, the data require:
///
/// 1. along a sheet, where the points lie on fewer dimensions within their reading errors (ManifoldMapFits);
/// 2. the patch map, where reading errors exceed 5e-4 of the range: local fits cannot average them out. Not for more
///    than 4 coordinates or 2^18 points, for which it would take too long;
/// 3. local maps otherwise.
///
/// Reading errors are those of the options, else the sds that the series knows, else estimated (noise_level). They and
/// their consequences are noted in `result`.
/// @throws std::invalid_argument as the finders do.
[[nodiscard]] std::unique_ptr<CycleFinder> choose_finder(const Series& series, const SectionPoints& section,
                                                         const CycleSearchOptions& options, CycleSearch& result);

}  // namespace orbid::orbits
