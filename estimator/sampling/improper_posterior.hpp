#pragma once

#include "estimator/estimate/estimate.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/problem/block_set.hpp"

namespace orbid::estimator {

/// Refuses an estimate from which no samples can be drawn.
/// @throws models::DataError when it has not converged or has equality constraints
/// @throws std::invalid_argument when it does not belong to the problem
void refuse_unfit(const Problem& problem, const Estimate& estimate);

/// Refuses a posterior whose integral is infinite, as far as can be seen at the estimate. A sampler would drift without
/// end, and all its results would depend on its length.
///
/// @throws models::DataError naming the parameter, group or block. Parameters: in a direction that leaves the data
///         unchanged, which neither a proper prior nor two bounds of a member close. Latent states: of a block whose
///         records do not determine them. Scales without prior and floor: of a group without records; one that has
///         relative errors, which carry all of the error as s -> 0; one that is fitted exactly, or can be (its rows
///         have full row rank). A full covariance without prior: of more responses than records.
void refuse_improper(const Problem& problem, const BlockSet& set, const Estimate& estimate);

}  // namespace orbid::estimator
