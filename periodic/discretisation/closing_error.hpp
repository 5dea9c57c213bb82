#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "periodic/discretisation/discretisation.hpp"

namespace orbid::periodic {

/// The gaps between the steps of a discretised orbit, F_j(z_j) - z_{j+1} - 2 pi turns_j, and their derivatives.
struct ClosingError {
    bool simulated = false;                  ///< all steps could be; everything else is meaningful only if so
    bool sticking = false;                   ///< some step contains sticking
    Eigen::MatrixXd error;                   ///< shape (d, N)
    std::vector<Eigen::MatrixXd> jacobians;  ///< dF_j / dz_j, shape (d, d) each
    Eigen::MatrixXd by_ln_time;              ///< shape (d N, 1) where T is unknown, (d N, 0) otherwise
    Eigen::MatrixXd parameters;              ///< shape (d N, f): dF_j / dtheta below each other
};

/// Steps are evaluated in parallel, each into its own place.
///
/// @param nodes  shape (d, N).
/// @param turns  whole turns from z_j to z_{j+1} in each entry, shape (d, N).
[[nodiscard]] ClosingError closing_error(const Discretisation& discretisation, const Eigen::MatrixXd& nodes,
                                         double time, const Eigen::MatrixXd& turns,
                                         std::span<const Eigen::Index> free = {});
/// The same with whole turns not taken off.
[[nodiscard]] ClosingError closing_error(const Discretisation& discretisation, const Eigen::MatrixXd& nodes,
                                         double time);

}  // namespace orbid::periodic
