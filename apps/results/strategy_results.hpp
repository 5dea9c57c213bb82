#pragma once

#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/results/posterior_results.hpp"
#include "estimator/estimate/estimate.hpp"
#include "identification/problem/identification_result.hpp"

namespace orbid::apps {

using identification::AlternativeResult;
using identification::LogEvidence;
using identification::MatchingResult;
using identification::StageResult;
using CriticismResult = identification::ComparisonResult;

/// A ln Bayes factor in words (Kass and Raftery, Journal of the American Statistical Association 90:773-795, 1995): 1,
/// 3 and 5 separate "hardly", "positively", "strongly" and "very strongly".
[[nodiscard]] std::string in_words(double ln_bayes_factor);

/// The additions of a strategy, its matching and its criticism to a result.
struct StrategyResults {
    std::vector<StageResult> stages;  ///< of a strategy of several
    std::vector<MatchingResult> matching;
    std::optional<CriticismResult> criticism;
};

/// Parameters as result.json shows them.
[[nodiscard]] nlohmann::ordered_json estimated_list(const std::vector<estimator::Estimated>& list,
                                                    const std::map<std::string, double>& references);
[[nodiscard]] nlohmann::ordered_json counts_json(const std::vector<estimator::ResidualCount>& counts);

/// Blocks of result.json: "stages", "matching", "criticism"; left out when empty.
void add_strategy(const StrategyResults& results, const std::map<std::string, double>& references,
                  nlohmann::ordered_json& result);

/// Tables for standard output.
[[nodiscard]] std::string stages_summary(const StrategyResults& results);
[[nodiscard]] std::string matching_summary(const StrategyResults& results);
[[nodiscard]] std::string criticism_summary(const StrategyResults& results);

}  // namespace orbid::apps
