#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include "orbits/records/series.hpp"
#include "orbits/sections/time_smoothing.hpp"

namespace orbid::orbits {

/// A section made from samples in time.
struct SampledSection {
    Series series;                       ///< kind section, with the errors of points and times left after smoothing
    std::vector<TimeWindow> windows;     ///< per coordinate of the samples; none: the samples were taken as they are
    Eigen::VectorXd sample_deviation;    ///< sd of the errors of one sample, per coordinate of the samples
    Eigen::MatrixXd reading_covariance;  ///< mean of the points' covariances, per coordinates of `series`
    std::size_t breaks = 0;              ///< places where a hole or an undecided crossing cuts the record
};

/// The plane coordinate = value and the direction in which it is crossed.
struct PlaneCrossing {
    Eigen::Index coordinate = 0;
    double value = 0.0;  ///< [unit of the coordinate]
    int direction = 1;   ///< +1: from below, -1: from above
};

/// Crossings of a plane by a sampled motion.
///
/// Every coordinate is smoothed by local polynomials in time. Their window is the one that best predicts held-out
/// samples near the crossings (best_window), narrowed() where the sds of samples are at most 0.5 % of the range: cycles
/// average over many crossings. At a crossing the plane's coordinate passes the value for good: it must be 3 sds of the
/// smoothed coordinate beyond the value before and after. The instant t* is the root of the polynomial; the other
/// coordinates are their polynomials at t*, with
///
///     Cov = diag(sigma_d^2 v_d) + x' x'^T sigma_c^2 v_c / c'^2
///
/// where v are the polynomials' variances for unit errors and c is the plane's coordinate.
///
/// Holes: missing samples are bridged up to half of the window's half width (at least one); a longer hole ends the
/// segment. So does an excursion over the value and back within 3 sds, which may or may not be a crossing. An angle
/// crosses `value` modulo 2 pi, but not at the opposite point of the circle.
///
/// @param interrupted  asked all along. @throws models::Stopped if it says so
/// @return sections without the plane's coordinate, with times and deviations; angles are in one turn.
/// @throws std::invalid_argument for sections, fewer than two coordinates, a coordinate or direction that does not
///         exist, a value that is not finite; DataError for one that is never crossed, samples that are not
///         equidistant.
/// Cost: linear in the samples.
[[nodiscard]] SampledSection plane_section(const Series& samples, const PlaneCrossing& crossing,
                                           const std::function<bool()>& interrupted = {});

/// States of a forced motion at one phase of the forcing, from samples.
///
/// If every instant of the section falls on a sample (the sampling divides the period), the samples are used unchanged.
/// Otherwise the coordinates are smoothed as for plane_section and evaluated at the instants. A section without samples
/// in the window is missing (nan).
///
/// @param period  [s] of the forcing, > 0, at least two sampling intervals.
/// @param phase   [rad] of the forcing; Series::phase is that at time 0.
/// @param interrupted  asked all along. @throws models::Stopped if it says so
/// @throws std::invalid_argument for sections; DataError for a period out of range, segments shorter than a period
///         throughout, samples that are not equidistant.
[[nodiscard]] SampledSection stroboscopic_section(const Series& samples, double period, double phase,
                                                  const std::function<bool()>& interrupted = {});

}  // namespace orbid::orbits
