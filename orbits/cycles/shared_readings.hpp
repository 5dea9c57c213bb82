#pragma once

#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/cycle.hpp"
#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/local_maps/manifold_map.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// How the errors of a section's points and times move a cycle whose maps were fitted to them.
///
/// A fit's value and time are sums of the images and return times of its neighbours. To first order their errors are
///
///     sum_i w_i (e_{i+1} - D_i e_i),   e_i = (errors of point i, error of its time)
///
/// with the slopes D of the map. One point may be an image in one fit and a start in the next one, or take part in the
/// fits of several cycles: their errors are then not independent. The result takes all of it into account.
///
/// @param section   with errors_known()
/// @param maps      of the cycle's points
/// @param response  of the cycle's records to errors of (value, time) of every map, shape (records, (n + 1) p)
/// Cov(cycle c, cycle d) = H_c' H_d over the points that both depend on.
[[nodiscard]] ReadingShares errors_by_readings(const SectionPoints& section, const std::vector<ManifoldMap>& maps,
                                               const Eigen::MatrixXd& response);

/// Writes them as Cycle::common, by as few columns as they need (shorten_common_errors).
/// @param readings  one per cycle, empty where there is none
void share_readings(const std::vector<ReadingShares>& readings, std::vector<Cycle>& cycles);

}  // namespace orbid::orbits
