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
    std::vector<int> rotation;   ///< turns per cycle, one per angle; empty: unknown
    Eigen::MatrixXd points;      ///< shape (n, p), angles in (-pi, pi]
    Eigen::MatrixXd covariance;  ///< shape (n p, n p), coordinate fastest: joint, of all points; never zero
    std::vector<std::complex<double>> multipliers;  ///< largest modulus first
    Eigen::VectorXd ln_multiplier;                  ///< ln |multiplier|, same order
    Eigen::MatrixXd ln_multiplier_covariance;       ///< shape (n, n)
    /// Errors that this cycle shares with the others of its list, because one map gave them all: G, shape (n p + n, r),
    /// rows as `covariance`, then as `ln_multiplier`, or (n p + n + 1, r) with `time` as the last row;
    /// Cov(cycle c, cycle d) = G_c G_d'. G G' is part of all covariances. Empty: no errors are known to be shared, or
    /// the earlier partner of a mirror pair has them.
    Eigen::MatrixXd common;
    double time = std::numeric_limits<double>::quiet_NaN();     ///< [s] until it closes; nan: the series has no times
    double time_sd = std::numeric_limits<double>::quiet_NaN();  ///< [s]
    std::string code;             ///< one symbol per point, see CycleSearchOptions::partition; empty: no partition
    std::size_t recurrences = 0;  ///< points of the series that led here
    std::optional<std::size_t> mirror;  ///< index of the mirror partner in the list; its own when symmetric
    std::vector<std::string> quality;   ///< flags in words; empty = no reservations
    Eigen::VectorXd time_covariance;    ///< of `time` with the points, shape (n p) [unit s]; empty: taken as 0
};

/// What a search for cycles found and what it missed.
struct CycleSearch {
    std::vector<Cycle> cycles;   ///< by period, then by descending recurrences; deterministic
    std::vector<int> missing;    ///< requested periods without a cycle
    std::size_t candidates = 0;  ///< starts tried
    std::size_t rejected = 0;    ///< refined but not accepted
    bool spline_map = false;     ///< the cycles come from one map fitted to all data, not from local maps
    /// Reading errors as given or estimated, shape (n, n), in the coordinates' units; empty: not estimated.
    Eigen::MatrixXd reading_covariance;
    /// Complete sentences about the data and the search that readers of the result should know.
    std::vector<std::string> remarks;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
