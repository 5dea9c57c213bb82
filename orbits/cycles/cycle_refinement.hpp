#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "orbits/local_maps/cell_map.hpp"
#include "orbits/local_maps/cycle_multiplier.hpp"
#include "orbits/local_maps/fit_choice.hpp"
#include "orbits/local_maps/local_map.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Newton on all p points of a start together, F(x_j) - x_{j+1} = 0, j mod p, on the polynomials of the cells that
/// contain the points. Near the solution the cells no longer change, so that Newton converges although cells do not
/// join smoothly.
///
/// @param points  shape (n, p), scaled units; at success the closed orbit of the cells' polynomials, wrapped.
/// @return false: a point reached a place without a map, or Newton wandered.
[[nodiscard]] bool close_on_cells(const SectionPoints& section, const CellMap& map, Eigen::MatrixXd& points);

/// A closed orbit of the local maps.
struct RefinedCycle {
    bool converged = false;
    Eigen::MatrixXd points;                   ///< shape (n, p), scaled units, wrapped
    std::vector<LocalMap> maps;               ///< one per point, centred there up to the last correction
    std::vector<std::vector<FitSize>> sizes;  ///< of every point: of its map, then those of other fits
    [[nodiscard]] std::vector<Eigen::MatrixXd> jacobians(const SectionPoints& section) const;  ///< at the points
};

/// Newton on all p points together,  F_j(x_j) - x_{j+1} = 0, j mod p  (P8 for all points at once), on local maps that
/// are frozen meanwhile. They are then fitted again around the result, until the points stay within a small part of the
/// neighbourhoods' radius.
///
/// @param start  shape (n, p), scaled units: points that nearly close.
[[nodiscard]] RefinedCycle refine_cycle(const SectionPoints& section, const FitChoice& choice,
                                        const Eigen::MatrixXd& start);

/// The same with fits of one size.
[[nodiscard]] RefinedCycle refine_cycle(const SectionPoints& section, const FitChoice& choice,
                                        const Eigen::MatrixXd& start, const FitSize& size);

/// The cycle on other fits of the same points, not renewed: shows how the result depends on the fit.
///
/// @param fits  of every point, as fitted to RefinedCycle::sizes.
/// @param which the fit to take; points that have no such fit keep their map.
[[nodiscard]] RefinedCycle alternative_cycle(const SectionPoints& section, const RefinedCycle& cycle,
                                             const std::vector<PlacedFits>& fits, std::size_t which);

/// J of Newton's method: A_j on the diagonal, -1 from each point to the next, cyclic; shape (n p, n p).
[[nodiscard]] Eigen::MatrixXd coupled_matrix(const std::vector<Eigen::MatrixXd>& jacobians);

/// Errors of a refined cycle, scaled units.
struct CycleUncertainty {
    Eigen::MatrixXd covariance;  ///< shape (n p, n p), coordinate fastest
    CycleMultipliers multipliers;
    Eigen::MatrixXd ln_multiplier_covariance;  ///< shape (n, n)
    /// Largest over the points: distance of other fits over their predicted errors; at least 1.
    double disagreement = 1.0;
};

/// Covariance of all points together and of ln|multipliers|.
///
/// Errors e_j of the fits' values and E_j of their jacobians (local_map_covariance) move the points by the coupled
/// system dx_{j+1} - A_j dx_j = e_j (for p = 1 and independent reading errors this is (M6)), and ln|multipliers| by
/// their derivative along E_j + F''_j dx_j. Where other fits of a point are farther away than their predicted errors
/// allow, its errors grow accordingly, since the residuals of one fit do not show this. The ln|multipliers| of the
/// cycles on other fits (`refits`) are added as outer products. Never zero: floored_covariance() raises small
/// eigenvalues.
///
/// @param fits  of every point around it, as fitted to RefinedCycle::sizes.
[[nodiscard]] CycleUncertainty cycle_uncertainty(const SectionPoints& section, const RefinedCycle& cycle,
                                                 const std::vector<PlacedFits>& fits,
                                                 const std::vector<RefinedCycle>& refits);

}  // namespace orbid::orbits
