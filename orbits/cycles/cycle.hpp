#pragma once

#include <complex>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// An unstable periodic orbit found in a series.
struct Cycle {
    int period = 0;              ///< prime period, in sections
    std::vector<int> rotation;   ///< turns per cycle, one per angle; empty: the data do not tell
    Eigen::MatrixXd points;      ///< shape (n, p), angles in (-pi, pi]
    Eigen::MatrixXd covariance;  ///< shape (n p, n p), coordinate fastest: of all points together; never zero
    std::vector<std::complex<double>> multipliers;              ///< largest modulus first
    Eigen::VectorXd ln_multiplier;                              ///< ln |multiplier|, same order
    Eigen::MatrixXd ln_multiplier_covariance;                   ///< shape (n, n)
    double time = std::numeric_limits<double>::quiet_NaN();     ///< [s] until it closes; nan: the series has no times
    double time_sd = std::numeric_limits<double>::quiet_NaN();  ///< [s]
    std::string code;             ///< one symbol per point, see CycleSearchOptions::partition; empty: no partition
    std::size_t recurrences = 0;  ///< points of the series that led here
    std::optional<std::size_t> mirror;  ///< index of the mirror partner in the list; own index when symmetric
    std::vector<std::string> quality;   ///< flags in words; empty = nothing to remark
};

/// What a search for cycles found, and what it did not.
struct CycleSearch {
    std::vector<Cycle> cycles;   ///< by period, then by descending recurrences; deterministic
    std::vector<int> missing;    ///< periods asked for of which no cycle was found
    std::size_t candidates = 0;  ///< starts tried
    std::size_t rejected = 0;    ///< refined but not accepted
    bool spline_map = false;     ///< the cycles are those of one map fitted to all data, not of local maps
    /// Reading errors as given or estimated, shape (n, n), in the coordinates' units; empty: not estimated.
    Eigen::MatrixXd reading_covariance;
    /// Whole sentences about the data and the search that the reader of the result should know.
    std::vector<std::string> remarks;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
