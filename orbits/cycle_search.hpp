#pragma once

#include <optional>
#include <vector>

#include "models/system.hpp"
#include "orbits/cycle.hpp"
#include "orbits/series.hpp"

namespace orbid::orbits {

struct CycleSearchOptions {
    std::vector<int> periods{1, 2, 3, 4, 5};  ///< each in [1, 64]
    double box = 0.01;  ///< linear size of a recurrence box relative to Series::scale(), in (0, 0.5)
    /// Points of a local fit, at least the number of its coefficients + 2. Where noise blurs so few, fits of 4, 16 and
    /// 64 times as many are tried and the largest sd decides.
    int neighbours = 32;
    int order = 2;                ///< of the local maps: 1 linear, 2 quadratic
    int minimum_recurrences = 3;  ///< candidates with fewer are not tried
    /// Sections at this phase are mapped onto each other by x -> S x: a mirrored copy of every point serves as
    /// neighbour and every cycle gets its mirror partner. Empty: no symmetry.
    std::optional<std::vector<double>> symmetry_signs;
};

/// Unstable periodic orbits of a section series (van de Water 1991; P5-P8; mathematics.md, section 2).
///
/// A cycle is accepted when its local fits explain their neighbours' images, refits with half and double the
/// neighbours agree with it and its sds are below 2e-3 of the range. Covariances are meant relatively: error / sd is of
/// the order of one half everywhere on clean data.
///
/// Cycle::rotation stays empty for angles read wrapped (in one turn): the section then shows turns only modulo one.
/// With a symmetry, partners are exact images of each other and rest on the same data: whoever uses both counts them
/// twice. A cycle that is its own partner has its halves averaged and its variances doubled for the same reason.
///
/// @throws std::invalid_argument for options out of range, a series that is not a section, fewer than
///         10 x neighbours usable points, coordinates without spread.
[[nodiscard]] CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options);

}  // namespace orbid::orbits
