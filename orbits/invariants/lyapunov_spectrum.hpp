#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct LyapunovOptions {
    int order = 0;               ///< of the local maps, 1 to 4; 0: chosen by the data
    std::size_t neighbours = 0;  ///< of a local map, at least its coefficients + 2; 0: chosen by the data
    /// Largest number of steps followed, >= 1000. A longer series is sampled by evenly spread pieces of 1024 steps;
    /// their local maps still use all points. The statistical error falls like 1 / sqrt(steps): 0.2 % at the default
    /// for the Henon map.
    std::size_t steps = std::size_t{1} << 18;
    std::optional<std::vector<double>> symmetry_signs = {};  ///< mirrored points are neighbours too; empty: none
    std::function<bool()> interrupted = {};  ///< asked all along; if it says so, models::Stopped is thrown
};

/// Lyapunov exponents of a measured series. Rates are per section, or per second when the series has times.
struct LyapunovSpectrum {
    Eigen::VectorXd exponents;  ///< shape (n), descending; nan: the data do not resolve it
    Eigen::VectorXd sds;        ///< from the scatter of blocks of the series, without fit errors
    double dimension = 0.0;     ///< Kaplan-Yorke; nan when a needed exponent is not resolved
    bool timed = false;         ///< rates are per second
    double mean_time = 1.0;     ///< of a step [s]; 1 without times
    /// The largest exponent again, from the growth of distances between neighbours, without any fit.
    double divergence_rate = 0.0;
    double divergence_sd = 0.0;
    int order = 0;
    std::size_t neighbours = 0;
    std::size_t stride = 1;         ///< samples per step; sections: 1
    std::size_t steps = 0;          ///< followed, without those that only align the directions
    std::size_t lost = 0;           ///< points without a local map
    double prediction_error = 0.0;  ///< median over points left out of their own fits, relative to the range
    double attenuation = 0.0;       ///< mean share by which reading errors lower the fitted slopes
    std::vector<std::string> remarks;
};

/// Exponents from the derivatives of local maps along the series, separated by QR (Eckmann, Kamphorst, Ruelle and
/// Ciliberto 1986; Benettin et al. 1980):
///
///     A_i Q_i = Q_{i+1} R_i,   lambda_j = < ln R_i(j, j) > / < return time >
///
/// Order and neighbours of the local maps are those that best predict a sample of the points from fits without them.
/// Sampled flows are treated as the map over `stride` samples, in which the state moves a tenth of its range. Exponents
/// that the neighbours do not resolve (attractors thinner than the fit's error) are nan. Reading errors bias all
/// exponents: see `attenuation` and the remarks.
///
/// Deterministic; parallel over pieces of the series.
///
/// @throws std::invalid_argument for options out of range; DataError for fewer than 500 points with an image, no piece
///         of at least 40 steps; as SectionPoints.
[[nodiscard]] LyapunovSpectrum lyapunov_spectrum(const Series& series, const LyapunovOptions& options = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
