#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/errors/noise_model.hpp"
#include "estimator/interface/chain_share.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/problem/block_set.hpp"
#include "estimator/problem/bounded_step.hpp"
#include "estimator/problem/coordinate.hpp"

namespace orbid::estimator {

/// The constant part of an estimate.
struct Problem {
    std::vector<FreeParameter> parameters;
    std::vector<Coordinate> coordinates;
    Eigen::VectorXd lower;  ///< in coordinates u, the support of uniform priors included
    Eigen::VectorXd upper;
    std::vector<const Residual*> residuals;
    std::vector<Channel> channels;
    std::vector<NoiseModel> laws;
    std::vector<ErrorCoordinate> errors;  ///< all error parameters, in the order of psi
    /// Joint priors with the places of their parameters.
    struct Joint {
        JointNormalPrior prior;
        std::vector<Eigen::Index> place;
    };
    std::vector<Joint> joint_priors;
    EstimateOptions options;
    bool polished = true;         ///< steps go on beyond the tolerance while they gain digits
    Collective* ranks = nullptr;  ///< over which the estimate is spread; null: none
    ChainShare share;
};

/// The present state of an estimate.
struct State {
    Eigen::VectorXd theta;  ///< natural units
    Eigen::VectorXd u;      ///< coordinates
    Latents latents;
    Eigen::VectorXd psi;        ///< error parameters in their coordinates
    bool errors_known = false;  ///< false: scales without a start value are taken from the first residuals
};

/// Checks the whole call and converts it to coordinates.
///
/// @param active  one per residual; error laws are made from its groups.
/// @throws std::invalid_argument naming value and rule: see estimate().
[[nodiscard]] Problem set_up(const std::vector<FreeParameter>& parameters,
                             const std::vector<const Residual*>& residuals, const std::vector<ActiveSet>& active,
                             const std::vector<DerivedQuantity>& derived, const EstimateOptions& options);

/// Starts of parameters, latent states and scales.
/// @throws std::invalid_argument when latent states of a set do not fit its layout.
[[nodiscard]] State initial_state(const Problem& problem, const std::vector<ActiveSet>& active);

/// The group of a channel.
[[nodiscard]] const Group& group_of(const Problem& problem, int channel);

/// Parameters in natural units, kept within bounds that coordinates and back may leave by rounding.
[[nodiscard]] Eigen::VectorXd natural_parameters(const Problem& problem, const Eigen::VectorXd& u);
void set_natural_parameters(const Problem& problem, const Eigen::VectorXd& u, Eigen::VectorXd& theta);

/// The parameter prior at u to second order.
[[nodiscard]] PriorModel prior_at(const Problem& problem, const Eigen::VectorXd& u);

/// Size of each parameter in its coordinate: the effect there of a change by max(|value|, typical size).
[[nodiscard]] Eigen::VectorXd sizes(const Problem& problem, const Eigen::VectorXd& theta);

/// Which error parameters are estimated and have data (none in an intermediate stage), shape (error parameters).
[[nodiscard]] std::vector<bool> free_errors(const Problem& problem, const BlockSet& set);

}  // namespace orbid::estimator
