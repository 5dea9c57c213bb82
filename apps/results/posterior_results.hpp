#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/bootstrap.hpp"
#include "estimator/exploration/marginal.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "identification/comparison/residual_diagnosis.hpp"
#include "identification/problem/identification_result.hpp"

namespace orbid::apps {

using identification::GroupDiagnostic;
using identification::LogEvidence;
using identification::OutlierRecord;

/// {"value", "reason"}; null for what there is not.
[[nodiscard]] nlohmann::ordered_json evidence_json(const LogEvidence& evidence);

/// Requested results beyond the estimate, as far as computed.
struct PosteriorResults {
    std::vector<std::string> parameters;  ///< names, in the order of theta
    std::vector<estimator::Optimum> optima;
    std::vector<estimator::StartedRun> runs;  ///< of the several starts
    std::optional<estimator::PosteriorSample> sample;
    std::vector<estimator::Profile> profiles;
    std::vector<estimator::Marginal> marginals;
    std::optional<estimator::Bootstrap> bootstrap;
    std::vector<GroupDiagnostic> diagnostics;
    std::vector<std::pair<std::string, std::string>> refused;  ///< "posterior", "profile", ...: why it was not done
};

/// "complete", "interrupted", "failed".
[[nodiscard]] std::string_view name(estimator::SampleStatus status);

/// Blocks of result.json: "posterior", "profile", "marginals", "intervals", "optima", "diagnostics"; null if not
/// requested.
void add_posterior(const PosteriorResults& results, nlohmann::ordered_json& result);

/// Content of posterior.csv: chain, draw, one column per sampled quantity, minus_log_density of the sampled
/// coordinates; numbers read back to the bit. Chains and draws count from 1.
[[nodiscard]] std::string draws_text(const estimator::PosteriorSample& sample);

/// Blocks of result.json: "intervals".
[[nodiscard]] nlohmann::ordered_json bootstrap_json(const estimator::Bootstrap& bootstrap);

/// Content of bootstrap.csv: replicate from 1, status, then value and sd of each quantity; numbers read back to the
/// bit. A replicate that has failed has empty cells.
[[nodiscard]] std::string replicates_text(const estimator::Bootstrap& bootstrap);

/// Table for standard output: sds and intervals by curvature and by simulation.
[[nodiscard]] std::string bootstrap_summary(const estimator::Bootstrap& bootstrap);

/// Tables for standard output; empty when nothing was requested.
[[nodiscard]] std::string posterior_summary(const PosteriorResults& results);

}  // namespace orbid::apps
