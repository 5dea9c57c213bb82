#pragma once

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::orbits {

/// What the phase argument of a system grows by in a second: omega [rad/s] of a forced model, 1 of one with measured
/// inputs (its phase is the time on the clock of the signal), 0 of the others.
[[nodiscard]] double phase_rate(const models::System& system, const Eigen::VectorXd& theta);

}  // namespace orbid::orbits
