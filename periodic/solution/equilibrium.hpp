#pragma once

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::periodic {

/// The closed orbit of an autonomous flow is an equilibrium: its states do not move. Within the time of the orbit the
/// field carries the first one no farther than 1e-6 of the scale, and no two are farther apart than that.
[[nodiscard]] bool at_equilibrium(const models::System& system, const Eigen::VectorXd& theta,
                                  const Eigen::MatrixXd& states, double time, const Eigen::VectorXd& scale);

}  // namespace orbid::periodic
