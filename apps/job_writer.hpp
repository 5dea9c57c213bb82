#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job.hpp"

namespace orbid::apps {

/// What wrote a job.json, for the record: { "orbid", "0.1.0" }, ... . Not part of the job.
using Versions = std::vector<std::pair<std::string, std::string>>;

/// The complete job with every default filled in, as job.json holds it: reading it gives an equal job.
///
/// Keys stand in a fixed order, numbers read back to the same double, infinite bounds are null.
/// @param folder  where job.json will stand: paths are written relative to it.
[[nodiscard]] nlohmann::ordered_json job_document(const Job& job, const std::filesystem::path& folder,
                                                  const Versions& versions = {});

/// The document as text.
[[nodiscard]] std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions = {});

namespace detail {

// Blocks of the document, one per file of the writer.
[[nodiscard]] nlohmann::ordered_json data_document(const Job& job, const DataJob& data,
                                                   const std::filesystem::path& folder);
[[nodiscard]] nlohmann::ordered_json estimate_document(const Job& job);
[[nodiscard]] nlohmann::ordered_json prior_document(const estimator::Prior& prior);
[[nodiscard]] std::string path_text(const std::filesystem::path& path, const std::filesystem::path& folder);
[[nodiscard]] std::string parameter_name(const Job& job, Eigen::Index index);
[[nodiscard]] std::string coordinate_name(const Job& job, Eigen::Index index);
[[nodiscard]] nlohmann::ordered_json state_document(const Eigen::VectorXd& state);

}  // namespace detail

}  // namespace orbid::apps
