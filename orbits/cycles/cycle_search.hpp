#pragma once

#include <functional>
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

/// Divides the section into named parts, which give each cycle a symbolic code.
struct Partition {
    Eigen::Index coordinate = 0;
    std::vector<double> boundaries;  ///< [coordinate's unit], ascending
    std::string symbols;             ///< one character per part, boundaries + 1 in all, lowest part first
};

struct CycleSearchOptions {
    /// How the map of the section onto itself is estimated from the data.
    enum class Method {
        automatic,      ///< spline_map where local fits cannot average out the reading errors, else local_maps
        local_maps,     ///< polynomials fitted to the nearest neighbours of each point of a cycle
        spline_map,     ///< one smooth map fitted to all data, with errors in points and images
        closest_return  ///< the paper's: linear about one recurrent point, without intercept (P5-P8)
    };
    Method method = Method::automatic;
    std::vector<int> periods{1, 2, 3, 4, 5};  ///< each in [1, 64]
    /// Linear size of a recurrence box relative to Series::scale(), in (0, 0.5). Every piece of the series that returns
    /// within it gives a start. A wider box finds more cycles and takes longer. closest_return: the paper has 0.01.
    double box = 0.1;
    /// Points of a local fit, at least its number of coefficients + 2. 0: chosen by the data (closest_return: at least
    /// 32, all within two boxes).
    int neighbours = 0;
    int order = 0;                ///< of the local maps, 1 to 6; 0: chosen by the data, cycle by cycle
    int minimum_recurrences = 1;  ///< cycles found from fewer points of the series are left out
    /// x -> S x maps the section at this phase onto itself. A mirrored copy of each point serves as neighbour, and each
    /// cycle gets its mirror partner. Empty: no symmetry.
    std::optional<std::vector<double>> symmetry_signs;
    /// Covariance of the reading errors of a point, shape (n, n), in the coordinates' units. Empty: estimated from the
    /// data.
    Eigen::MatrixXd reading_covariance;
    std::optional<Partition> partition;
    std::function<bool()> interrupted{};  ///< asked all along; if it says so, models::Stopped is thrown; empty: never
    /// Called before each part of the search: what follows, and how many of `total` parts are done; empty: never.
    std::function<void(const std::string& part, std::size_t done, std::size_t total)> progress{};
};

/// Unstable periodic orbits of a section series (van de Water 1991; P5-P8; mathematics.md, section 2).
///
/// With local maps, every coarse itinerary that returns within the box gives a start. It is closed on cheap maps of
/// small cells, then on the best fits that the data allow at each point. A cycle is accepted on three conditions. The
/// fits explain their neighbours' images with the neighbour itself left out. Other orders and numbers of neighbours
/// give the same cycle within 3e-3. Its sds are below 2e-3 of the range. Covariances are relative: error / sd is 0.5 to
/// 0.8 rms on clean data and at reading errors up to 1e-3.
///
/// Cycle::rotation stays empty for angles read wrapped (in one turn): such a section determines turns only modulo one.
/// Partners under a symmetry are exact images of each other from the same data: using both would count the data twice.
/// For the same reason a cycle that is its own partner has its halves averaged and its variances doubled.
///
/// @throws std::invalid_argument for options out of range, a series that is not a section; DataError for
///         fewer than 10 x neighbours usable points, coordinates without spread.
[[nodiscard]] CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options);

}  // namespace orbid::orbits

#pragma GCC visibility pop
