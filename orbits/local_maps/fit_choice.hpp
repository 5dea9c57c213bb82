#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "orbits/local_maps/local_map.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// A fit of order `order` to the `neighbours` nearest points.
struct FitSize {
    int order = 2;
    std::size_t neighbours = 32;
};

/// The fits of one place and their data.
struct PlacedFits {
    Neighbourhood neighbours;    ///< of the widest fit; the others use the nearest of them
    std::vector<LocalMap> fits;  ///< in the order of the requested sizes; some may be unusable
};

/// Chooses order and number of neighbours for a place: the fit with the smallest predicted error of the value
/// (LocalMap::value_sd).
///
/// For every order the neighbourhood grows from about twice the number of coefficients while that helps: truncation
/// stops it early on clean data, late on noisy data.
class FitChoice {
public:
    /// @param order       1 to 6, 0: all are tried.
    /// @param neighbours  0: several are tried.
    FitChoice(const SectionPoints& section, const NeighbourIndex& grid, int order, std::size_t neighbours);

    /// The best size, then the best of another order, then the best of the same order with another number of
    /// neighbours; the last two only if they exist. Empty: no fit is usable.
    [[nodiscard]] std::vector<FitSize> best(const Eigen::VectorXd& place) const;

    [[nodiscard]] PlacedFits fitted(const Eigen::VectorXd& place, const std::vector<FitSize>& sizes) const;

private:
    const SectionPoints& section_;
    const NeighbourIndex& grid_;
    int lowest_ = 1, highest_ = 6;
    std::size_t neighbours_ = 0;
    std::size_t most_ = 0;  ///< neighbours of a fit
    std::shared_ptr<const Monomials> monomials_;
};

}  // namespace orbid::orbits
