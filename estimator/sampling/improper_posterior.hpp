#pragma once

#include "estimator/estimate/estimate.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/problem/block_set.hpp"

namespace orbid::estimator {

/// Refuses a posterior whose integral is infinite, as far as can be seen at the estimate. A sampler would drift without
/// end, and all its results would depend on its length.
///
/// @throws std::invalid_argument naming the parameter, group or block:
///   - parameters in a direction that leaves the data unchanged, which neither a proper prior nor two bounds of a
///   member
///     close;
///   - a block whose latent states its records do not determine;
///   - a scale without prior and floor whose group has no records, can be fitted exactly by parameters and latent
///   states
///     (its rows have full row rank: integrated over them, the likelihood stays finite as s -> 0), is fitted exactly,
///     or has relative errors, which carry all of the error as s -> 0;
///   - a full covariance without prior of more responses than records.
void refuse_improper(const Problem& problem, const BlockSet& set, const Estimate& estimate);

}  // namespace orbid::estimator
