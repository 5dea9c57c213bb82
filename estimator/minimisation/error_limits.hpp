#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/problem/linearisation.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// Limits of the error parameters, in their coordinates psi.
struct ErrorLimits {
    /// For scales: the effect of rounding of theta and z alone on the residuals; for others: their own.
    Eigen::VectorXd floor;
    Eigen::VectorXd ceiling;  ///< of scales without a prior: a thousand times the residuals' size; of others: their own
    Eigen::VectorXd size;     ///< ln of the root mean square of the residuals for scales, the present value for others
    double rounding = 0.0;    ///< least change that residuals can show, in sds of the errors: the largest of all scales
};

/// @param latent_fit  latent_fit_sizes() at the start of the minimisation.
[[nodiscard]] ErrorLimits error_limits(const Problem& problem, const BlockSet& set, const State& state,
                                       const std::vector<BlockRows>& rows, const Eigen::VectorXd& latent_fit);

/// ln of the root mean square of the residuals of each law after an unweighted fit of the latent states, at its first
/// parameter; -infinity elsewhere and without latent states. Latent states may start exactly at the data, where
/// residuals give no information about a scale.
[[nodiscard]] Eigen::VectorXd latent_fit_sizes(const Problem& problem, const BlockSet& set, const State& state,
                                               const std::vector<BlockRows>& rows, double matching);

/// ln of the error that would explain how far neighbours of a chain fail to meet. It stands at the first parameter of
/// each law of records that depend on their own block alone. It is the rms gap of constraints and linked records,
/// divided by the rms length of their latent derivatives and multiplied by that of the law's own. -infinity elsewhere,
/// nan where nothing links the blocks.
[[nodiscard]] Eigen::VectorXd gap_sizes(const Problem& problem, const BlockSet& set,
                                        const std::vector<BlockRows>& rows);

/// Why a full covariance cannot be estimated without a prior; empty when it can. Either each response has fewer records
/// than m + q / m + 5 (m responses, q = `determined` parameters). Or the covariance is about to become singular: the
/// responses can be fitted exactly together and the likelihood has no bound.
[[nodiscard]] std::string why_no_covariance(const Problem& problem, const BlockSet& set, const Eigen::VectorXd& psi,
                                            Eigen::Index determined);

}  // namespace orbid::estimator
