#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"

namespace orbid::orbits {

/// Coordinates of which each is the derivative of the one after it: [v, x] where x' = v holds exactly. Noise enters
/// the first one, the others integrate it.
struct NoiseChain {
    std::vector<Eigen::Index> coordinates;
};

/// The chains of a system; every coordinate belongs to one. An equation x' = v is recognised by its values, which are
/// those of v to the last bit at all states looked at. Equations that follow each other in a ring, and a second one
/// with the same derivative, have noise of their own.
/// @param states  shape (n, m), m > 0, at which equations are compared, with one phase each.
/// @param theta   all parameters of the system.
[[nodiscard]] std::vector<NoiseChain> noise_chains(const models::System& system, const Eigen::MatrixXd& states,
                                                   const std::vector<double>& phases, const Eigen::VectorXd& theta);

/// What a diffusion adds to the state over an interval, as independent errors: U d = D^(1/2) s xi with xi of unit
/// variance and the diffusion s^2 of each chain.
struct LinkErrors {
    Eigen::MatrixXd unmix;      ///< U, shape (n, n): a triangular matrix with ones on its diagonal, |U| = 1
    Eigen::VectorXd deviation;  ///< D^(1/2), shape (n), > 0
};

/// The noise dv = ... + s dW of each chain over `duration` T > 0, with i, j integrations of it:
///
///     cov(d_i, d_j) = s^2 T^(i+j+1) / (i! j! (i+j+1))
///
/// For x' = v this is s^2 [[T^3/3, T^2/2], [T^2/2, T]]. Within an interval forces act on the noise as well; their share
/// is of the order of T times their slopes and left out: below one per cent with thirty nodes in a turn, as large as
/// ten per cent with ten. In return the covariance depends neither on states nor on parameters, so that no other term
/// of the likelihood moves them.
[[nodiscard]] LinkErrors link_errors(const std::vector<NoiseChain>& chains, double duration);

/// Units of a diffusion and of its root, of a coordinate in this unit: "(rad/s)^2/s", "rad/s/sqrt(s)".
[[nodiscard]] std::string diffusion_unit(std::string_view unit);
[[nodiscard]] std::string root_diffusion_unit(std::string_view unit);

/// Process noise of a residual by multiple shooting.
struct ProcessNoise {
    std::vector<NoiseChain> chains;
    std::vector<LinkErrors> links;  ///< by pattern of the plan; empty where no other node follows
    LinkErrors usual;               ///< of an interval of the usual duration
    double duration = 1.0;          ///< [s] of that
};

}  // namespace orbid::orbits
