#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/block_set.hpp"
#include "estimator/bounded_step.hpp"
#include "estimator/linearisation.hpp"

namespace orbid::estimator {

/// The error scales as a minimisation of their own, Phi_psi(x) of (M9) with x = ln s, at a fixed linearisation:
///
///     Phi_psi = sum_g n_g x_g + 1/2 ||w||^2 - ln p(psi) + 1/2 ln|H|
///
/// H over the latent states (ml) or over latent states and decided parameters (restricted). With `profile`, w and the
/// parameter prior are taken at the minimum of the linear model over (theta, z) for each x: the min in (M9). Without,
/// at the present point: far from the minimum the linear model promises too much.
struct ScaleProblem {
    const BlockSet* set = nullptr;
    std::vector<BlockRows> rows;     ///< columns of theta in the basis of decided directions (see BoundedStep)
    Eigen::MatrixXd prior_rows;      ///< sqrt(curvature) of the parameter prior times basis, shape (parameters, rank)
    Eigen::VectorXd prior_gradient;  ///< basis^T gradient, shape (rank)
    std::vector<Prior> priors;       ///< of each channel's scale
    std::vector<bool> free;          ///< channels whose scale is estimated
    bool restricted = true;
    bool profile = false;
};

/// Value, gradient and Fisher information of Phi_psi in x = ln s; shape (channels).
struct ScalePoint {
    double value = 0.0;
    Eigen::VectorXd gradient;  ///< includes the priors of the scales
    Eigen::VectorXd data_gradient;
    Eigen::VectorXd fit;  ///< e^T V^-1 e shared out over the channels, whitened
    Eigen::MatrixXd information;
    /// Information of the decided parameters carried by each channel in the coordinates R_theta y (orthonormal at the
    /// estimate): sum over channels = identity less the prior's share. For Satterthwaite's degrees of freedom.
    std::vector<Eigen::MatrixXd> share;
    Eigen::MatrixXd triangle;  ///< R of the decided parameters with prior, latent states eliminated
};

/// The gradient of (M10) for mixed groups under one covariance shape, with L the Cholesky factor of the shape,
/// w whitened residuals, Q orthonormal columns that span the whitened sensitivities:
///     d/dx_g = n_g - sum_{i in g} [ (L^-T w)_i (L w)_i + sum_k (L^-T Q)_ik (L Q)_ik ]
/// and the expected information F - 2 <K_g, K_h>, K_g = sym[(L Q)^T E_g (L^-T Q)].
[[nodiscard]] ScalePoint evaluate_scales(const ScaleProblem& problem, const Eigen::VectorXd& x);

struct ScaleMinimum {
    Eigen::VectorXd x;
    double before = 0.0;
    double after = 0.0;  ///< <= before
    int steps = 0;
    /// largest |gradient| of a free scale over the root of its information: distance to the minimum in sds of ln s
    double distance = 0.0;
    std::vector<bool> at_floor;  ///< scale held at its floor: residuals at rounding level
};

/// Fixed-point steps of (M10) from afar, Fisher scoring near the minimum; each accepted step decreases Phi_psi.
///
/// @param floor, ceiling  limits of x, shape (channels).
[[nodiscard]] ScaleMinimum minimise_scales(const ScaleProblem& problem, const Eigen::VectorXd& x,
                                           const Eigen::VectorXd& floor, const Eigen::VectorXd& ceiling);

}  // namespace orbid::estimator
