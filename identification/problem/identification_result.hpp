#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "identification/problem/structural_report.hpp"
#include "orbits/cycles/cycle_search.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// How a stage has ended; none: it was skipped.
using StageStatus = std::optional<estimator::EstimateStatus>;
/// As of an estimate, or "skipped".
[[nodiscard]] inline std::string_view status_name(StageStatus status) {
    return status ? estimator::name(*status) : std::string_view("skipped");
}

/// One stage of a strategy.
struct StageResult {
    std::string stage;  ///< Stage::name
    StageStatus status;
    std::string message;
    std::vector<estimator::Estimated> parameters;
    std::vector<estimator::Estimated> derived;
    std::vector<estimator::ResidualCount> counts;
    double objective = std::numeric_limits<double>::quiet_NaN();
    int iterations = 0;
    int evaluations = 0;
    bool chosen = false;    ///< its estimate is the result
    bool needless = false;  ///< it was left out, since a series before it is explained
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
    /// Process noise of a coordinate, dv = f dt + sqrt(value) dW.
    struct Diffusion {
        std::string name;
        std::string unit;    ///< of `value`: "(rad/s)^2/s"
        double value = 0.0;  ///< 0 where none is found
        double sd = 0.0;
        double lower95 = 0.0, upper95 = 0.0;  ///< nan where none is found
        double least = 0.0;                   ///< below it noise cannot be told from none
    };
    std::vector<Diffusion> diffusion;  ///< empty unless process noise is estimated
    /// Per parameter: the estimate minus that at ten times looser matching, in sds of this difference; empty: not
    /// known.
    std::vector<std::pair<std::string, double>> shift;
    std::vector<std::string> warnings;  ///< whole sentences
};

/// The logarithm of the evidence, or why there is none.
struct LogEvidence {
    std::optional<double> value;
    std::string reason;  ///< empty with a value
};

/// Another model, fitted to the same data.
struct AlternativeResult {
    std::string name;  ///< "variant harmonic", "without k1"
    StageStatus status;
    std::string message;
    std::vector<estimator::Estimated> parameters;
    LogEvidence ln_bayes_factor;               ///< ln p(y | the problem's model) - ln p(y | this one)
    double ln_bayes_factor_uncertainty = 0.0;  ///< by minimisations that ended just before their minimum
    /// Objective of this model minus that of the problem's: ln B without the volumes of their posteriors, known even if
    /// one has not converged.
    double objective_difference = std::numeric_limits<double>::quiet_NaN();
    LogEvidence score;  ///< held-out ln density of the problem's model minus that of this one
    double score_error = std::numeric_limits<double>::quiet_NaN();  ///< sd of it, from the scatter of the folds
    std::optional<std::size_t> large_defects;                       ///< of a series with nodes
    std::size_t used = 0;  ///< blocks (cycles, segments, intervals) that both models are compared on
};

/// The problem's model against others.
struct ComparisonResult {
    std::string model;  ///< ComparisonOptions::model
    std::string stage;  ///< whose residuals they are compared on
    std::optional<std::size_t> large_defects;
    std::size_t intervals = 0;
    LogEvidence score;  ///< held-out ln density of the problem's model
    double score_error = std::numeric_limits<double>::quiet_NaN();
    std::vector<AlternativeResult> alternatives;
};

struct StageRun;

/// The estimate and all that it came from.
struct IdentificationResult {
    estimator::Estimate estimate;             ///< of the best stage, with the status of the last one
    std::vector<StageResult> stages;          ///< in their order
    std::vector<orbits::Cycle> cycles;        ///< all measured cycles, those of a harvest included
    std::vector<estimator::Optimum> optima;   ///< of several starts
    std::vector<estimator::StartedRun> runs;  ///< likewise
    std::vector<MatchingResult> matching;
    std::optional<ComparisonResult> comparison;
    std::shared_ptr<const StageRun> best;  ///< residuals of the best stage (not installed); null: no stage has run
    StructuralReport structure;            ///< what the readings can determine, found before the stages
};

}  // namespace orbid::identification

#pragma GCC visibility pop
