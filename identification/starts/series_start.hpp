#pragma once

#include <vector>

#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_options.hpp"
#include "identification/starts/series_attempt.hpp"
#include "identification/starts/series_nodes.hpp"

namespace orbid::identification {

/// Whether an estimate by multiple shooting is worth a search for its start: something is not read, or the data decide
/// how closely nodes match.
[[nodiscard]] bool needs_search(const IdentificationProblem& problem);

/// A start from which the model follows the records, if one is found.
///
/// Attempts are estimates with exact matching, which begins loose and is tightened in stages, and with priors as wide
/// as the starts are large, so that nothing runs off while matching is loose. The first one begins at the parameters'
/// starts with the interval that they suggest. Others have intervals of an eighth and of a third of a turn. The rest
/// begins at random parameters, drawn from priors a little narrower, where hidden states are looked for anew. Two
/// attempts that agree end the search.
///
/// An attempt has succeeded when it converges and its residuals are those of the readings alone: as small as readings
/// scatter about a smooth course, see orbits::reading_noise(), and uncorrelated in time. Its nodes and parameters are
/// the start then, and matching stays exact. Otherwise the start is the best attempt where readings tell no states
/// without the model, and the problem's own where they do.
///
/// @param parameters  with their starts.
/// @throws orbits::DataError when no attempt can begin.
[[nodiscard]] SeriesStart search_series_start(const IdentificationProblem& problem, const Options& options,
                                              const EstimateSetup& setup,
                                              const std::vector<estimator::FreeParameter>& parameters,
                                              const SeriesSearch& search);

}  // namespace orbid::identification
