#pragma once

#include <Eigen/Core>

#include "orbits/local_maps/cell_map.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Newton on all p points of a start together, F(x_j) - x_{j+1} = 0, j mod p, on the polynomials of the cells that
/// contain the points. Near the solution the cells no longer change, so that Newton converges although cells do not
/// join smoothly.
///
/// @param points  shape (n, p), scaled units; at success the closed orbit of the cells' polynomials, wrapped.
/// @return false: a point reached a place without a map, or Newton wandered.
[[nodiscard]] bool close_on_cells(const SectionPoints& section, const CellMap& map, Eigen::MatrixXd& points);

}  // namespace orbid::orbits
