#pragma once

#include <string>
#include <string_view>

#include "apps/results/result_file.hpp"
#include "estimator/estimate/estimate.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// Readable text of the estimate, for standard output: status, parameters with intervals and their method, deviations
/// from known values, error scales, undetermined parameters, counts of residuals, predictions. 100 columns, no colour,
/// digits by the standard deviations.
///
/// @param title  of the job; may be empty.
[[nodiscard]] std::string estimate_summary(const estimator::Estimate& estimate, const ResultContext& context,
                                           std::string_view title);

/// Cycles found, by period: number, points, recurrences, accuracy; missing periods.
[[nodiscard]] std::string cycles_summary(const orbits::CycleSearch& search);

}  // namespace orbid::apps
