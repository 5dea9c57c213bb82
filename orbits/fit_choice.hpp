#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "orbits/box_grid.hpp"
#include "orbits/local_map.hpp"
#include "orbits/section_points.hpp"

namespace orbid::orbits {

/// Fits of one place, best first, and the neighbours they rest on.
struct RankedFits {
    Neighbourhood neighbours;  ///< of the widest fit; the others use the nearest of them
    std::vector<LocalMap> fits;
    std::vector<std::size_t> sizes;  ///< neighbours of each fit
};

/// Which order and how many neighbours suit a place: the fit with the smallest predicted error of the value,
/// leave-one-out times the square root of the leverage (LocalMap::value_sd).
///
/// For every order the neighbourhood grows from about twice the number of coefficients for as long as that helps:
/// truncation ends it on clean data early, on noisy data late.
class FitChoice {
public:
    /// @param order       1 to 6, 0: tried are all.
    /// @param neighbours  0: tried are several.
    FitChoice(const SectionPoints& section, const BoxGrid& grid, int order, std::size_t neighbours);

    /// Usable fits only; may be empty.
    [[nodiscard]] RankedFits ranked(const Eigen::VectorXd& place) const;

private:
    const SectionPoints& section_;
    const BoxGrid& grid_;
    int lowest_ = 1, highest_ = 6;
    std::size_t neighbours_ = 0;
    std::size_t most_ = 0;  ///< neighbours of a fit
    std::shared_ptr<const Monomials> monomials_;
};

}  // namespace orbid::orbits
