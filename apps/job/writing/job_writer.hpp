#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job/job.hpp"
#include "apps/job/version.hpp"

namespace orbid::apps {

/// The complete job with all defaults, as in job.json: reading it gives an equal job.
///
/// Keys have a fixed order, numbers read back to the same double, infinite bounds are null.
/// @param folder  folder of job.json: paths are written relative to it.
[[nodiscard]] nlohmann::ordered_json job_document(const Job& job, const std::filesystem::path& folder,
                                                  const Versions& versions = {});

/// The document as text.
[[nodiscard]] std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions = {});

}  // namespace orbid::apps
