#pragma once

#include <span>
#include <vector>

#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// The gaps between the steps of a discretised orbit, F_j(z_j) - z_{j+1} - 2 pi turns_j, and their derivatives.
struct ClosingError {
    bool simulated = false;           ///< all steps could be; everything else is meaningful only if so
    bool sticking = false;            ///< some step contains sticking
    MatrixXd error;                   ///< shape (d, N)
    std::vector<MatrixXd> jacobians;  ///< dF_j / dz_j, shape (d, d) each
    std::vector<MatrixXd> factors;    ///< the same, of steps in pieces those of each piece; the first one applied first
    MatrixXd by_ln_time;              ///< shape (d N, 1) where T is unknown, (d N, 0) otherwise
    MatrixXd parameters;              ///< shape (d N, f): dF_j / dtheta below each other
};

/// @param nodes  shape (d, N).
/// @param turns   whole turns from z_j to z_{j+1} in each entry, shape (d, N).
/// @param pieces  into which each step is split; empty: none is.
[[nodiscard]] ClosingError closing_error(const Discretisation& discretisation, const MatrixXd& nodes, double time,
                                         const MatrixXd& turns, std::span<const Index> free = {},
                                         std::span<const int> pieces = {});
/// The same with whole turns not taken off.
[[nodiscard]] ClosingError closing_error(const Discretisation& discretisation, const MatrixXd& nodes, double time);

}  // namespace orbid::periodic
