#pragma once

#include <limits>

#include "estimator/estimate.hpp"

namespace orbid::estimator {

/// -ln p of one number in the coordinate in which steps are taken, with derivatives in that coordinate.
struct PriorTerm {
    double value = 0.0;      ///< +infinity outside the support
    double gradient = 0.0;   ///< d value / du
    double curvature = 0.0;  ///< > 0 where the prior is curved: d^2 value / du^2, or its Gauss-Newton part if negative
};

/// The coordinate u of a natural number x: u = x (linear) or u = ln x (log).
///
/// Priors are densities of x; in u they carry the Jacobian, -ln p(u) = -ln p(x(u)) - ln |dx/du|. A flat prior has no
/// term in u, whatever the coordinate (M8).
struct Coordinate {
    Scale scale = Scale::linear;

    [[nodiscard]] double at(double natural) const;     ///< u(x); log needs x > 0 (x = 0 gives -infinity)
    [[nodiscard]] double natural(double u) const;      ///< x(u)
    [[nodiscard]] double slope(double natural) const;  ///< dx/du at x: 1 or x
    [[nodiscard]] PriorTerm term(const Prior& prior, double u) const;
    /// sd of the prior in u: exact where the prior is normal in u, by the slope at `natural` otherwise; infinite for
    /// flat.
    [[nodiscard]] double prior_sd(const Prior& prior, double natural) const;
};

}  // namespace orbid::estimator
