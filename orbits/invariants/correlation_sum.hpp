#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// Pairs of one octave of distances, in all and by the stretches of the series that hold an end of them. Leaving
/// stretches out gives the errors.
struct OctaveCount {
    static constexpr std::size_t stretches = 16;
    static constexpr int followed = 16;  ///< steps

    struct Pairs {
        std::array<double, 3> within{};       ///< nearer than r, r / sqrt 2, r / 2
        double ln_ratio = 0.0;                ///< sum of ln(r / distance) over pairs with distance > 0
        double different = 0.0;               ///< of these
        std::array<double, followed> stay{};  ///< nearer than r at steps 0 ... k - 1, of those that can be followed
    };
    Pairs all;
    std::array<Pairs, stretches> touching;  ///< with one end or both in the stretch
    double candidates = 0.0;                ///< all pairs of the points, near or not

    /// The pairs without an end in a stretch.
    [[nodiscard]] Pairs without(std::size_t stretch) const;
};

/// Counts the pairs nearer than `radius` in the largest-coordinate norm among some points of the series.
///
/// @param chosen   indices of points, ascending. @param radius  in (0, 0.5], scaled units.
/// @param theiler  pairs need |i - j| > theiler. @param ahead  steps that every point of the series can be followed,
///                 `stride` points each; shape (points.size()).
/// Cost: sorting into boxes of edge `radius` over at most three coordinates, then the pairs of neighbouring boxes.
/// Deterministic; parallel over boxes' points.
[[nodiscard]] OctaveCount count_pairs(const SectionPoints& points, const std::vector<std::uint32_t>& chosen,
                                      double radius, std::size_t theiler, const std::vector<std::uint8_t>& ahead,
                                      std::size_t stride);

}  // namespace orbid::orbits
