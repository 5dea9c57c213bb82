#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job/job.hpp"
#include "apps/job/version.hpp"
#include "identification/problem/record_errors.hpp"

namespace orbid::apps {

/// The complete job with all defaults, as in job.json: reading it gives an equal job.
///
/// Keys have a fixed order, numbers read back to the same double, infinite bounds are null.
/// @param folder  folder of job.json: paths are written relative to it.
[[nodiscard]] nlohmann::ordered_json job_document(const Job& job, const std::filesystem::path& folder,
                                                  const Versions& versions = {});

/// The document as text.
[[nodiscard]] std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions = {});

namespace detail {

// Blocks of the document, one per file of the writer.
[[nodiscard]] nlohmann::ordered_json estimate_document(const Job& job);
/// "errors" and "covariance" of a residual.
void add_errors(const Job& job, const std::vector<identification::RecordErrors>& errors,
                const std::vector<identification::JointErrors>& covariances, nlohmann::ordered_json& residual);
/// A sd as in "errors": a number, or { "estimate": { "start", "prior" } }.
[[nodiscard]] nlohmann::ordered_json scale_document(const estimator::ErrorScale& scale);
[[nodiscard]] nlohmann::ordered_json joint_priors_document(const std::vector<estimator::JointNormalPrior>& priors);
/// A tied parameter has only its tie.
[[nodiscard]] nlohmann::ordered_json tie_document(const estimator::FreeParameter& parameter);

}  // namespace detail

}  // namespace orbid::apps
