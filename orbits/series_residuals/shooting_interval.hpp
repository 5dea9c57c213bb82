#pragma once

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// Sampling intervals from node to node such that errors of a node grow by no more than a factor e (the spectral norm
/// of X, coordinates in units of their ranges), and predictions from the states that the data say stay within a fifth
/// of the range; both in nine of ten places of the record and at the given parameters. 1 for sections.
///
/// Longer intervals need fewer nodes, but bend: exp(growth) is what a Newton step has to linearise.
///
/// @param systems  one per segment of the series, each with its measured inputs, or one in all.
/// @param theta    shape (q), all parameters of the system.
[[nodiscard]] Eigen::Index shooting_interval(std::span<const std::shared_ptr<const models::System>> systems,
                                             const Eigen::VectorXd& theta, const Series& series,
                                             const models::Sensor& sensor, const std::vector<std::size_t>& segments);

}  // namespace orbid::orbits
