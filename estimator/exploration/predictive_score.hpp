#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"

namespace orbid::estimator {

/// Records that are left out together in cross-validation.
struct HeldOut {
    std::vector<std::string> labels;  ///< of the blocks
    std::size_t records = 0;
    bool known = false;        ///< false: see message; log_density is nan
    double log_density = 0.0;  ///< ln p(held-out records | the others)
    std::string message;
};

struct PredictiveScore {
    bool known = false;           ///< every fold is known
    double log_density = 0.0;     ///< sum over the folds that are known
    double standard_error = 0.0;  ///< of that sum, from the scatter of the folds; nan for one fold
    std::vector<HeldOut> folds;
    std::string message;
    bool interrupted = false;
};

/// Held-out predictive score: blocks are left out in turn, the rest is estimated again, and
///
///     ln p(y_k | y_-k) = ln of the integral for all data - ln of the integral without y_k      (Laplace both)
///
/// so it includes the uncertainty of theta, of latent states and of error parameters, and flat priors cancel. For a
/// linear model with known errors this is the normal density with covariance V + J C J^T. Latent states of a left-out
/// block are integrated with a flat density in their own units. Scores of models with the same latent states are
/// comparable.
///
/// Blocks linked by constraints are left out together. Sets of blocks stay those of the estimate. Folds are
/// computed in parallel; the same result for any number of threads. A fold is unknown when the rest does not converge,
/// leaves a direction undetermined that the fold determines, or leaves an estimated error scale without data.
///
/// @param folds  at most this many, > 1: block k goes to fold k mod folds; fewer blocks make fewer folds.
/// @throws models::DataError when there are fewer than two separate sets of blocks, or the estimate failed
/// @throws std::invalid_argument when folds < 2, or the estimate is of other parameters
[[nodiscard]] PredictiveScore predictive_score(const std::vector<FreeParameter>& parameters,
                                               const std::vector<const Residual*>& residuals,
                                               const EstimateOptions& options, const Estimate& estimate,
                                               int folds = 10);

}  // namespace orbid::estimator
