#pragma once

#include "estimator/interface/random_stream.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// One error of an error law with scale 1.
/// @param shape   dof or correlation of the laws that have one.
/// @param before  of the record before it, of autoregressive errors; null: the first one.
[[nodiscard]] double unit_error(const ErrorDistribution& distribution, double shape, const double* before,
                                RandomStream& random);

/// Whether the scale of a law is the root mean square of its errors.
[[nodiscard]] bool has_unit_square(const ErrorDistribution& distribution);

}  // namespace orbid::estimator
