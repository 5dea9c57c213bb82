#pragma once

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::periodic {

/// States of a closed orbit of an autonomous flow that do not move: neither does the field carry the first one farther
/// than 1e-6 of the scale within the time of the orbit, nor are two of them farther apart than that.
[[nodiscard]] bool at_equilibrium(const models::System& system, const Eigen::VectorXd& theta,
                                  const Eigen::MatrixXd& states, double time, const Eigen::VectorXd& scale);

}  // namespace orbid::periodic
