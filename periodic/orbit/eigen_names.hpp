#pragma once

#include <Eigen/Core>

namespace orbid::periodic {

// What every source of this room computes with. Public headers do without.
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace orbid::periodic
