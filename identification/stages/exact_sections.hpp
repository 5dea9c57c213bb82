#pragma once

#include <optional>
#include <vector>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// Sections that the model explains when their nodes are matched exactly.
struct ExactSections {
    SeriesStart start;
    ProblemResiduals residuals;
    estimator::Estimate estimate;  ///< with the bias of its course
};

/// Whether a stage estimates from measured sections alone whose matching is left to us.
[[nodiscard]] bool may_match_exactly(const StageInput& input, const ProblemResiduals& residuals);

/// Steps of the first estimate of such a stage, from which exact_sections() goes on.
inline constexpr int first_look = 60;

/// Matches measured sections exactly, from where an estimate with errors of matching of their own has ended.
///
/// Readings that err by more than 5e-4 of the range leave such errors much to do: every link that ends on a wrong
/// branch makes them larger, and sds with them. If the model is right, exact matching finds and mends those links
/// (with_mended_links()), and its sds are a fraction. It counts as right when all of series_doubt() is satisfied. Else,
/// where readings err less: nothing.
[[nodiscard]] std::optional<ExactSections> exact_sections(const StageInput& input,
                                                          const std::vector<estimator::FreeParameter>& parameters,
                                                          const ProblemResiduals& residuals,
                                                          const estimator::Estimate& estimate,
                                                          const estimator::EstimateOptions& options);

}  // namespace orbid::identification
