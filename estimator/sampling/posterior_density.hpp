#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/minimisation/minimum.hpp"
#include "estimator/problem/block_set.hpp"
#include "estimator/sampling/hamiltonian.hpp"
#include "estimator/sampling/unbounded_coordinate.hpp"

namespace orbid::estimator {

/// Parameters, latent states and error parameters together, in the units of the estimate.
struct PosteriorPlace {
    Eigen::VectorXd u;    ///< coordinates of theta
    Latents latents;      ///< per residual, per block
    Eigen::VectorXd psi;  ///< all error parameters in their coordinates
};

/// -ln of p(y | theta, z, psi) p(theta) p(psi) as a density of x = (v, z, w), numbers without limits:
///
///     v  the parameters, u(v) between their bounds; z  the latent states of the active blocks; w  the estimated error
///     parameters, psi(w) between their limits
///
/// Priors carry their Jacobians as in (M8): in u and psi, flat = no term there. The map to v and w brings its own. The
/// target is thus the posterior truncated to bounds and limits, whatever the map. Blocks are frozen.
class PosteriorDensity {
public:
    /// @param start  a place within the limits, on them or inside. The density starts there or, within a tenth of its
    ///               sd of a limit, slightly inside.
    PosteriorDensity(const Problem& problem, const BlockSet& set, PosteriorPlace start);

    [[nodiscard]] Eigen::Index dimension() const { return start_.size(); }
    /// -ln p at x with gradient (unless null); +infinity where a block cannot be evaluated. Thread-safe.
    [[nodiscard]] double operator()(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) const;
    [[nodiscard]] PosteriorPlace place(const Eigen::VectorXd& x) const;
    /// theta, shape (parameters).
    [[nodiscard]] Eigen::VectorXd natural(const PosteriorPlace& place) const {
        return natural_parameters(problem_, place.u);
    }

    [[nodiscard]] const Eigen::VectorXd& start() const { return start_; }
    /// Laplace covariance of x at the start: expected information of parameters and latent states with the priors'
    /// curvature, error parameters by differences of the gradient. Positive definite. Empty if nothing can be evaluated
    /// there.
    [[nodiscard]] const Eigen::MatrixXd& covariance() const { return covariance_; }
    /// Its part of the parameters in u; empty as well.
    [[nodiscard]] Eigen::MatrixXd parameter_covariance() const;

private:
    [[nodiscard]] Eigen::Index parameters() const { return static_cast<Eigen::Index>(problem_.parameters.size()); }
    /// -ln p and its gradient in (u, z, estimated psi).
    [[nodiscard]] double value(const PosteriorPlace& place, Eigen::VectorXd& gradient) const;
    [[nodiscard]] Eigen::MatrixXd information(const PosteriorPlace& place) const;
    [[nodiscard]] const UnboundedCoordinate* map(Eigen::Index i) const;
    void go_inside(PosteriorPlace& place, const Eigen::VectorXd& sd);

    const Problem& problem_;
    const BlockSet& set_;
    std::vector<UnboundedCoordinate> parameter_maps_;
    std::vector<Eigen::Index> free_errors_;  ///< index into psi of each sampled one
    std::vector<UnboundedCoordinate> error_maps_;
    PosteriorPlace base_;  ///< what is not sampled: latent states of other blocks, fixed error parameters
    Eigen::VectorXd start_;
    Eigen::MatrixXd covariance_;
};

}  // namespace orbid::estimator
