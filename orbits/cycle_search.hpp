#pragma once

#include <optional>
#include <vector>

#include "models/system.hpp"
#include "orbits/cycle.hpp"
#include "orbits/series.hpp"

namespace orbid::orbits {

struct CycleSearchOptions {
    std::vector<int> periods{1, 2, 3, 4, 5};  ///< each in [1, 64]
    double box = 0.01;            ///< linear size of a recurrence box relative to Series::scale(), in (0, 0.5)
    int neighbours = 32;          ///< points of a local fit, at least the number of its coefficients + 2
    int order = 2;                ///< of the local maps: 1 linear, 2 quadratic
    int minimum_recurrences = 3;  ///< candidates with fewer are not tried
    /// Sections at this phase are mapped onto each other by x -> S x: a mirrored copy of every point serves as
    /// neighbour and every cycle gets its mirror partner. Empty: no symmetry.
    std::optional<std::vector<double>> symmetry_signs;
};

/// Unstable periodic orbits of a section series (van de Water 1991; P5-P8; mathematics.md, section 2).
///
/// @throws std::invalid_argument for options out of range, a series that is not a section, fewer than
///         10 x neighbours usable points, coordinates without spread.
[[nodiscard]] CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options);

}  // namespace orbid::orbits
