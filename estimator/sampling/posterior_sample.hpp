#pragma once

#include <array>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/eigen_layout.hpp"
#include "estimator/sampling/nuts.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

using SampleOptions = NutsOptions;

/// Probabilities of the quantiles of a sampled quantity.
inline constexpr std::array sample_probabilities{0.025, 0.25, 0.5, 0.75, 0.975};

/// One number of the posterior, in natural units, from all draws of all chains.
struct SampledQuantity {
    std::string name;  ///< of errors: "group:scale", "group:dof", "group:relative", "group:correlation", or
                       ///< "covariance(group, group)" for the elements of a full covariance
    std::string unit;
    double mean = 0.0;
    double sd = 0.0;
    std::array<double, 5> quantiles{};  ///< at sample_probabilities
    double mean_error = 0.0;            ///< Monte-Carlo standard errors
    double sd_error = 0.0;
    std::array<double, 5> quantile_errors{};
    double rhat = 0.0;       ///< rank-normalised, split
    double bulk_size = 0.0;  ///< effective sample sizes
    double tail_size = 0.0;
};

/// Statistics of one chain.
struct SampledChain {
    double step = 0.0;
    double acceptance = 0.0;
    int divergences = 0;  ///< see NutsChain
    int saturated = 0;
    /// Mean square of the steps of the energy between draws over its variance; below 0.3 the tails are not reached.
    double energy_mixing = 0.0;
    long warm_up_evaluations = 0;
    long evaluations = 0;
};

/// failed: the density cannot be evaluated around the estimate. interrupted: the draws that every chain had made.
enum class SampleStatus { complete, interrupted, failed };

struct PosteriorSample {
    SampleStatus status = SampleStatus::failed;
    std::string message;
    bool trusted = false;  ///< every R-hat < 1.01, every effective sample size > 400, no divergences
    std::string distrust;  ///< why not, naming the worst; empty when trusted
    std::vector<SampledQuantity> parameters;
    std::vector<SampledQuantity> derived;
    std::vector<SampledQuantity> errors;                ///< estimated error parameters
    std::vector<std::string> names;                     ///< of the columns of draws: parameters, derived, errors
    std::vector<Eigen::MatrixXd> draws;                 ///< per chain, shape (draws, names), natural units
    std::vector<Eigen::VectorXd> potential;             ///< per chain: -ln p of each draw in sampled coordinates
    std::vector<std::vector<Eigen::VectorXd>> latents;  ///< means, per residual, per block; empty: takes no part
    std::vector<std::vector<Eigen::VectorXd>> latent_sds;
    std::vector<SampledChain> chains;
    double worst_rhat = 0.0;  ///< over all of the above, latent states and potential included
    double least_size = 0.0;
};

/// Draws from the posterior of an estimate: parameters, latent states and error parameters jointly. The only
/// approximation is the finite number of draws. It checks all that estimate() reports.
///
/// Target: p(y | theta, z, psi) p(theta) p(psi) of (M8), truncated to the bounds. A flat prior has no term in the
/// coordinate of its parameter (ln s for error scales). `options.variance` is not used: nothing is maximised. The set
/// of active blocks is the present one. Starts and first metric come from the estimate; a parameter that it holds at a
/// bound is sampled too.
///
/// @param start    estimate() of the same call, converged, or singular where priors or bounds decide the rest.
/// @param options  seed, chains and lengths; the same draws for any number of threads.
/// Cost: one evaluation of all residuals with derivatives per leapfrog step; memory of a dense metric per chain.
/// @throws std::invalid_argument where estimate() does, and when the estimate does not belong to the call
/// @throws models::DataError when nothing is estimated, the estimate has not converged, or equality constraints are
///         present. Also when the posterior is improper, naming the parameter, group or block. A parameter is
///         undetermined, or the data can be fitted exactly while a scale without prior and floor goes to zero.
[[nodiscard]] PosteriorSample sample_posterior(const std::vector<FreeParameter>& parameters,
                                               const std::vector<const Residual*>& residuals,
                                               const std::vector<DerivedQuantity>& derived,
                                               const EstimateOptions& estimate_options, const Estimate& start,
                                               const SampleOptions& options = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop
