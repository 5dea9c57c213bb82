#pragma once

#include <functional>

#include <Eigen/Core>

#include "orbits/cycle_residuals/one_period_residual.hpp"

namespace orbid::orbits {

/// A better start for the one-period prediction: each parameter in turn is tried on a coarse ladder around its start
/// (factors 2^(k/6), k = -12 .. 12; around 0: +- size 2^(k/2), k = -6 .. 6), in two rounds. The value with the smallest
/// misfit (OnePeriodResidual::misfit, PredictionResidual::misfit) is kept. The start is the first candidate, so a good
/// one stays.
///
/// The misfit has other minima, which a ladder steps over. All of 100 starts with a length within a factor of 2 and
/// frictions within a factor of 10, at point errors of 1e-4 and of 1e-3, led to the optimum; without it 33 of 40.
///
/// @param start, lower, upper, size  one per estimated parameter; candidates outside [lower, upper] are not tried.
/// @throws std::invalid_argument on wrong lengths.
/// Cost: 50 predictions of all points per parameter.
[[nodiscard]] Eigen::VectorXd scanned_start(const std::function<double(const Eigen::VectorXd&)>& misfit,
                                            const Eigen::VectorXd& start, const Eigen::VectorXd& lower,
                                            const Eigen::VectorXd& upper, const Eigen::VectorXd& size);
[[nodiscard]] Eigen::VectorXd scanned_start(const OnePeriodResidual& residual, const Eigen::VectorXd& start,
                                            const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                                            const Eigen::VectorXd& size);

}  // namespace orbid::orbits
