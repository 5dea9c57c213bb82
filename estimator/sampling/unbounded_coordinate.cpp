#include "estimator/sampling/unbounded_coordinate.hpp"

#include <algorithm>
#include <cmath>

#include "estimator/problem/coordinate.hpp"

namespace orbid::estimator {

namespace {

/// ln(1 + e^v) without overflow, and the v at which it is `value`.
double softplus(double v) {
    return std::max(v, 0.0) + std::log1p(std::exp(-std::abs(v)));
}
double softplus_inverse(double value) {
    return value + std::log(-std::expm1(-value));
}

}  // namespace

double UnboundedCoordinate::at(double u) const {
    if (has_lower() && has_upper()) return std::log((u - lower) / (upper - u));
    if (has_lower()) return softplus_inverse((u - lower) / width);
    if (has_upper()) return -softplus_inverse((upper - u) / width);
    return u;
}

double UnboundedCoordinate::bounded(double v) const {
    // From the nearer end, so that small distances from either keep their digits.
    if (has_lower() && has_upper())
        return v < 0.0 ? lower + (upper - lower) * logistic(v) : upper - (upper - lower) * logistic(-v);
    if (has_lower()) return lower + width * softplus(v);
    if (has_upper()) return upper - width * softplus(-v);
    return v;
}

double UnboundedCoordinate::ln_slope(double v) const {
    if (has_lower() && has_upper()) return std::log(upper - lower) - softplus(v) - softplus(-v);
    if (has_lower()) return std::log(width) - softplus(-v);
    if (has_upper()) return std::log(width) - softplus(v);
    return 0.0;
}

double UnboundedCoordinate::ln_slope_first(double v) const {
    if (has_lower() && has_upper()) return logistic(-v) - logistic(v);
    if (has_lower()) return logistic(-v);
    if (has_upper()) return -logistic(v);
    return 0.0;
}

double UnboundedCoordinate::ln_slope_second(double v) const {
    const int limits = (has_lower() ? 1 : 0) + (has_upper() ? 1 : 0);
    return -limits * logistic(v) * logistic(-v);
}

}  // namespace orbid::estimator
