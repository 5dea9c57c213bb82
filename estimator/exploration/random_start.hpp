#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/random_stream.hpp"

namespace orbid::estimator {

/// A start for a global search, in natural units and within the bounds; one uniform number per parameter.
///
/// Each parameter is drawn from the first of these that it has:
///     its proper prior, cut off at the bounds, the central 99 % of what is left (heavy tails would waste starts)
///     two finite bounds: uniform in its coordinate (log-uniform on a log scale with a positive lower bound)
///     the normal distribution around its start in its coordinate, with `width` times its size as sd (size = 1 for log:
///     a factor e; max(|start|, typical size) for linear), cut off at the bounds
/// Members of a joint prior are drawn together and then moved into their bounds; tied parameters follow.
///
/// @param width  > 0.
[[nodiscard]] Eigen::VectorXd random_start(const std::vector<FreeParameter>& parameters,
                                           const std::vector<JointNormalPrior>& joint_priors, double width,
                                           RandomStream stream);

}  // namespace orbid::estimator
