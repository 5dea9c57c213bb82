#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Cuts the section into named parts, so that a cycle has a symbolic code.
struct Partition {
    Eigen::Index coordinate = 0;
    std::vector<double> boundaries;  ///< [coordinate's unit], ascending
    std::string symbols;             ///< one character per part, boundaries + 1 of them, from below
};

struct CycleSearchOptions {
    /// How the map of the section onto itself is told from the data.
    enum class Method {
        automatic,      ///< spline_map where local fits cannot average the reading errors out, local_maps otherwise
        local_maps,     ///< polynomials fitted to the nearest neighbours of every point of a cycle
        spline_map,     ///< one smooth map fitted to all data at once, errors in both of its sides
        closest_return  ///< the paper's: one recurrent point as reference, linear, without intercept (P5-P8)
    };
    Method method = Method::automatic;
    std::vector<int> periods{1, 2, 3, 4, 5};  ///< each in [1, 64]
    /// Linear size of a recurrence box relative to Series::scale(), in (0, 0.5): a start is sought from every piece of
    /// the series that returns so near. Wider finds more cycles and takes longer. closest_return: 0.01 is the paper's.
    double box = 0.1;
    /// Points of a local fit, at least the number of its coefficients + 2; 0: chosen by the data (closest_return: at
    /// least 32, all within two boxes).
    int neighbours = 0;
    int order = 0;                ///< of the local maps, 1 to 6; 0: chosen by the data, cycle by cycle
    int minimum_recurrences = 1;  ///< points of the series that lead to a cycle; cycles with fewer are left out
    /// Sections at this phase are mapped onto each other by x -> S x: a mirrored copy of every point serves as
    /// neighbour and every cycle gets its mirror partner. Empty: no symmetry.
    std::optional<std::vector<double>> symmetry_signs;
    /// Covariance of the reading errors of a point, shape (n, n), in the coordinates' units. Empty: estimated from the
    /// data.
    Eigen::MatrixXd reading_covariance;
    std::optional<Partition> partition;
};

/// Unstable periodic orbits of a section series (van de Water 1991; P5-P8; mathematics.md, section 2).
///
/// By local maps: a start from every coarse itinerary that returns within the box, closed on cheap maps of small cells;
/// the orbits that come out are closed again on the best fits that the data allow at each of their points. A cycle is
/// accepted when these fits explain their neighbours' images with the neighbour itself left out, other orders and
/// numbers of neighbours give the same cycle within 3e-3 and its sds are below 2e-3 of the range. Covariances are meant
/// relatively: error / sd is 0.5 to 0.8 rms on clean data and at reading errors up to 1e-3.
///
/// Cycle::rotation stays empty for angles read wrapped (in one turn): the section then shows turns only modulo one.
/// With a symmetry, partners are exact images of each other and rest on the same data: whoever uses both counts them
/// twice. A cycle that is its own partner has its halves averaged and its variances doubled for the same reason.
///
/// @throws std::invalid_argument for options out of range, a series that is not a section, fewer than
///         10 x neighbours usable points, coordinates without spread.
[[nodiscard]] CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options);

}  // namespace orbid::orbits

#pragma GCC visibility pop
