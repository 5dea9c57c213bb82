#pragma once

#include <cmath>
#include <limits>

namespace orbid::estimator {

/// A coordinate v without limits for a number u in the open interval (lower, upper), either of which may be infinite.
///
///     none  u = v        lower  u = lower + w ln(1 + e^v)        upper  u = upper - w ln(1 + e^-v)
///     both  u = lower + (upper - lower) / (1 + e^-v)
///
/// All grow with v. A density p(u) becomes p(u(v)) du/dv in v: its truncation to the interval, sampled without walls.
/// With one limit, the plain logarithm of the distance makes a normal density fall like exp(-e^(2v)). That made 1 to 14
/// of 1000 trajectories of a half normal diverge. Far from the limit this form is linear and a normal density stays
/// one.
struct UnboundedCoordinate {
    double lower = -std::numeric_limits<double>::infinity();
    double upper = std::numeric_limits<double>::infinity();
    double width = 1.0;  ///< w > 0, of one limit: where the form changes, best the sd of u

    [[nodiscard]] double at(double u) const;        ///< v(u), u strictly inside
    [[nodiscard]] double bounded(double v) const;   ///< u(v); may round to a limit far out
    [[nodiscard]] double ln_slope(double v) const;  ///< ln du/dv
    [[nodiscard]] double slope(double v) const { return std::exp(ln_slope(v)); }  ///< du/dv
    /// First and second derivative of ln du/dv with respect to v.
    [[nodiscard]] double ln_slope_first(double v) const;
    [[nodiscard]] double ln_slope_second(double v) const;

    [[nodiscard]] bool has_lower() const { return lower > -std::numeric_limits<double>::infinity(); }
    [[nodiscard]] bool has_upper() const { return upper < std::numeric_limits<double>::infinity(); }
};

}  // namespace orbid::estimator
