#pragma once

#include "estimator/residual.hpp"

namespace orbid::orbits {

/// How the errors of one coordinate are distributed, beside their scale.
struct ErrorForm {
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;  ///< least value of an estimated scale, >= 0
    /// The sds of the readings are known (Segment::deviations): the scale is a factor on them.
    bool known_sds = false;
};

}  // namespace orbid::orbits
