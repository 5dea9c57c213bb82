#pragma once

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Upper bound of the sd of the errors of readings in a row, without a model: 1.4826 times the median of their fourth
/// differences over sqrt 70. Those of a smooth course are small, those of independent errors are sqrt 70 of their sd.
/// Missing readings (nan) are skipped. 0 with fewer than five.
/// @param angle  readings in one turn are followed across the cut of the circle.
[[nodiscard]] double reading_noise(const Eigen::Ref<const Eigen::VectorXd>& values, bool angle);

/// Samples from one upward crossing of the mean to the next, in the mean over a row of readings: about a period. The
/// length of the row where there are fewer than two. A crossing counts once the readings have been a quarter of an sd
/// below the mean.
[[nodiscard]] double samples_per_turn(const Eigen::Ref<const Eigen::VectorXd>& values);

}  // namespace orbid::orbits

#pragma GCC visibility pop
