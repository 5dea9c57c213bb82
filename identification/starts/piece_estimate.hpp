#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::identification {

/// What a piece of a record tells by itself.
struct PieceEstimate {
    double objective = std::numeric_limits<double>::infinity();
    Eigen::MatrixXd nodes;   ///< shape (n, nodes); empty when it did not converge
    std::size_t missed = 0;  ///< places where it misses, see missed_places()
    std::uint64_t work = 0;  ///< see ShootingResidual::work()
};

/// A rough estimate of a piece: 40 steps at most.
/// @param near       parameters, see nearly_held().
/// @param most_work  beyond which it ends without a result.
[[nodiscard]] PieceEstimate piece_estimate(const std::vector<estimator::FreeParameter>& near,
                                           const orbits::ShootingResidual& residual,
                                           const estimator::EstimateOptions& options,
                                           std::uint64_t most_work = std::numeric_limits<std::uint64_t>::max());

/// Parameters at an estimate, with normal priors as wide as its sds tell, or a thousandth where they do not, a
/// hundredth of an unfinished one.
[[nodiscard]] std::vector<estimator::FreeParameter> nearly_held(std::vector<estimator::FreeParameter> parameters,
                                                                const estimator::Estimate& estimate);

}  // namespace orbid::identification
