#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/fingerprint.hpp"

namespace orbid::apps {

/// What the file of a stage depends on: the program's version and every value below the given places of the complete
/// job, in the order given. A place that the job lacks counts as absent; the job holds hashes of its data files.
///
/// @param job     the complete job, as job.json holds it.
/// @param places  JSON Pointers: "/model", "/data".
[[nodiscard]] Fingerprint stage_fingerprint(const nlohmann::json& job, const std::vector<std::string_view>& places);

}  // namespace orbid::apps
