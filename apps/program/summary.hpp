#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "apps/results/result_file.hpp"
#include "estimator/estimate/estimate.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// The estimate for people, on standard output: status, parameters with intervals and how they were made, deviations
/// from known values, error scales, what the data do not determine, counts of residuals, predictions. 100 columns, no
/// colour, digits as the standard deviations support.
///
/// @param title  of the job; may be empty.
[[nodiscard]] std::string estimate_summary(const estimator::Estimate& estimate, const ResultContext& context,
                                           std::string_view title);

/// Cycles found, by period: how many, of how many points, from how many recurrences, how accurate; what is missing.
[[nodiscard]] std::string cycles_summary(const orbits::CycleSearch& search);

}  // namespace orbid::apps
