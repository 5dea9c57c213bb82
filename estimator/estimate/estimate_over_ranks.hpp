#pragma once

#include <vector>

#include "estimator/interface/chain_share.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/estimate_result.hpp"
#include "estimator/interface/residual.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::estimator {

/// estimate() with the records spread over ranks, which share no memory: called on every rank at once, with the
/// residuals of that rank. Nothing but sums over its blocks leaves a rank, and what the elimination of its part of a
/// chain leaves at the ends. All ranks go the same way, for all sums are formed on rank 0. The estimate is that of one
/// process but for rounding, and the same bytes for the same number of ranks.
///
/// Parameters, derived quantities, groups of the residuals and options are the same on every rank; functions of the
/// options may be set on some ranks only, and an interruption of one rank interrupts all. Where two ranks have a block,
/// its states start as on the second one. A residual that goes through stages goes through those of rank 0.
///
/// @param residuals  of this rank. A chain can go on from rank to rank only if it is the only residual.
/// @param share      how its chain goes on.
/// @return the estimate: numbers of all ranks, but `latents`, `latent_sds`, `residuals`, `counts` and `active` of the
///         blocks of this rank. No autocorrelations.
/// @throws std::invalid_argument as estimate(); for options that need all records in one place: clusters other than
///         none, verdict, full_hessian; on every rank when parameters, groups or options differ between ranks, or
///         parts of the chain do not fit together.
/// @throws std::runtime_error when another rank has ended, with an exception or without.
///
/// Blocks that stop too many steps end the estimate (they are not taken out), and minima at kinks are not looked for.
[[nodiscard]] Estimate estimate_over_ranks(const std::vector<FreeParameter>& parameters,
                                           const std::vector<const Residual*>& residuals, const ChainShare& share,
                                           Ranks& ranks, const std::vector<DerivedQuantity>& derived,
                                           const EstimateOptions& options);

}  // namespace orbid::estimator
