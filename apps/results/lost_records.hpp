#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "apps/results/result_file.hpp"
#include "estimator/interface/estimate_result.hpp"

namespace orbid::apps {

/// Share of its records below which an estimate is no valid answer for all of them.
inline constexpr double least_used_share = 0.75;

/// Whether the blocks of a residual of this type are records of the data. Cycles are not: the search proposes more of
/// them than there are.
[[nodiscard]] bool counts_records(std::string_view residual_type);

/// Which records take no part in an estimate, by name: "2 of 4 records are not used: waveform, low; waveform, high".
/// Empty where all do.
/// @param states  those that are not used although the model has such an orbit at the estimate are named as well.
[[nodiscard]] std::string lost_records(const std::vector<estimator::ResidualCount>& counts,
                                       const std::vector<SteadyState>& states);

/// Whether a residual uses less than `least_used_share` of its records.
[[nodiscard]] bool too_few_used(const std::vector<estimator::ResidualCount>& counts);

}  // namespace orbid::apps
