#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_options.hpp"
#include "models/system/system.hpp"

namespace orbid::identification {

/// What an estimate knows of a model's parameters.
struct ParameterPosterior {
    Eigen::VectorXd values;                           ///< of all parameters, the estimates in their places
    std::vector<Eigen::Index> parameters;             ///< of the model, those that were estimated
    std::vector<estimator::FreeParameter> estimated;  ///< their scales and bounds; one per entry of `parameters`
    Eigen::MatrixXd covariance;  ///< of these, in their natural units, shape (f, f); empty: not known
    Eigen::MatrixXd sample;      ///< draws from their posterior, shape (f, draws); empty: none
};

/// Vectors of all parameters, drawn from the posterior.
struct ParameterDraws {
    Eigen::MatrixXd values;    ///< shape (q, draws)
    bool from_sample = false;  ///< of the posterior; else normal in the scales of the estimate
    std::size_t outside = 0;   ///< draws beyond the bounds or domain of a parameter, which were drawn anew
};

/// Draws `count` vectors: evenly from the posterior sample where there is one, as many as it has at most. Otherwise
/// from the normal approximation in the scale of each parameter, u ~ N(u(theta), D^-1 C D^-1) with D = dtheta / du: a
/// logarithmic one stays positive, and its interval is skew. Draws outside bounds or domains are drawn anew.
///
/// @param held  parameters that keep their value although they were estimated: that of a branch
/// @throws std::invalid_argument without sample and covariance, or where hardly any draw lies inside.
[[nodiscard]] ParameterDraws draw_parameters(const models::System& system, const ParameterPosterior& posterior,
                                             std::size_t count, std::uint64_t seed,
                                             const std::vector<Eigen::Index>& held = {});

/// The estimated parameters but for those held, in order, and the covariance of these.
struct FreeCovariance {
    std::vector<Eigen::Index> parameters;
    Eigen::MatrixXd covariance;  ///< empty: not known
};
[[nodiscard]] FreeCovariance free_covariance(const ParameterPosterior& posterior,
                                             const std::vector<Eigen::Index>& held);

}  // namespace orbid::identification
