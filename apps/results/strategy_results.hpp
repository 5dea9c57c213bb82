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

namespace orbid::apps {

/// One stage of a strategy, as in the result.
struct StageResult {
    std::string stage;   ///< StageJob::name
    std::string status;  ///< as of an estimate, or "skipped"
    std::string message;
    std::vector<estimator::Estimated> parameters;
    std::vector<estimator::Estimated> derived;
    std::vector<estimator::ResidualCount> counts;
    double objective = std::numeric_limits<double>::quiet_NaN();
    int iterations = 0;
    int evaluations = 0;
    bool chosen = false;  ///< its estimate is the result
};

/// Defects at the nodes of a series, and the effect of looser matching.
struct MatchingResult {
    std::string experiment;
    std::size_t interval = 1;   ///< samples or sections from node to node
    std::size_t intervals = 0;  ///< matched ones
    std::size_t large = 0;      ///< of these: a coordinate misses by more than three sds of matching
    double expected = 0.0;      ///< share of them that the errors of matching explain
    struct Coordinate {
        std::string name;
        std::string unit;
        double sd = 0.0;       ///< of matching
        double rms = 0.0;      ///< of the defects
        double typical = 0.0;  ///< 1.4826 times their median size
    };
    std::vector<Coordinate> coordinates;
    /// Per parameter: the estimate minus that at ten times looser matching, in sds of this difference; empty: not
    /// known.
    std::vector<std::pair<std::string, double>> shift;
    std::vector<std::string> warnings;  ///< whole sentences
};

/// Another model, fitted to the same data.
struct AlternativeResult {
    std::string name;  ///< "variant harmonic", "without k1"
    std::string status;
    std::string message;
    std::vector<estimator::Estimated> parameters;
    LogEvidence ln_bayes_factor;               ///< ln p(y | the job's model) - ln p(y | this one)
    double ln_bayes_factor_uncertainty = 0.0;  ///< by minimisations that ended just before their minimum
    /// Objective of this model minus that of the job's: ln B without the volumes of their posteriors, known even if one
    /// has not converged.
    double objective_difference = std::numeric_limits<double>::quiet_NaN();
    LogEvidence score;  ///< held-out ln density of the job's model minus that of this one
    double score_error = std::numeric_limits<double>::quiet_NaN();  ///< sd of it, from the scatter of the folds
    std::optional<std::size_t> large_defects;                       ///< of a series with nodes
    std::size_t used = 0;  ///< blocks (cycles, segments, intervals) that both models are compared on
};

/// The job's model against others.
struct CriticismResult {
    std::string model;  ///< "variant crank", or the model's name
    std::string stage;  ///< whose residuals they are compared on
    std::optional<std::size_t> large_defects;
    std::size_t intervals = 0;
    LogEvidence score;  ///< held-out ln density of the job's model
    double score_error = std::numeric_limits<double>::quiet_NaN();
    std::vector<AlternativeResult> alternatives;
};

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
