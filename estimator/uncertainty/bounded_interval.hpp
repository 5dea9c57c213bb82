#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_result.hpp"

namespace orbid::estimator {

/// An interval of 95 % of a number that cannot leave [lower, upper].
struct BoundedInterval {
    double lower = 0.0;
    double upper = 0.0;
    /// The end that is a one-sided limit of 95 %; the other end is the bound. `none`: both ends are those of the usual
    /// interval, or both are bounds.
    BoundSide limit = BoundSide::none;
};

/// Interval of Student's t density about `mode` with scale `sd`, cut at bounds.
///
///     mode -+ quantile sd               if both ends lie within the bounds
///     [lower, b],  P(x < b | x > lower) = 0.95      if the lower end lies beyond (and so at the upper bound)
///     [lower, upper]                    if both lie beyond: the bounds are all that is known
///
/// The degrees of freedom are those that have this 97.5 % quantile. The mode may lie beyond a bound: then the data
/// push against it.
/// @param sd        > 0; else both ends are nan.
/// @param quantile  half width of the 95 % interval in sds, >= 1.95996.
/// @param lower     <= upper, may be infinite, all in one coordinate.
/// Source: the distribution function of a truncated density.
[[nodiscard]] BoundedInterval bounded_interval(double mode, double sd, double quantile, double lower, double upper);

/// The posterior of a parameter that rests on a bound, if it were released with all others: normal, in u.
struct ReleasedParameter {
    double step = 0.0;  ///< from the bound to the mode, which lies beyond the bound
    double sd = 0.0;    ///< nan where the data leave a direction open
};

/// From the curvature and the gradient at the estimate, the others at their best:
///
///     sd^2 = (H^-1)_ii over the free parameters and i,    step = -sd^2 g_i
///
/// @param curvature  H of the objective in u, shape (q, q).
/// @param gradient   of the objective in u, shape (q); zero along free parameters.
/// @param free       those that rest on no bound.
[[nodiscard]] ReleasedParameter released(const Eigen::MatrixXd& curvature, const Eigen::VectorXd& gradient,
                                         std::vector<Eigen::Index> free, Eigen::Index parameter);

}  // namespace orbid::estimator
