#pragma once

#include <filesystem>
#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/program/job_run.hpp"

namespace orbid::apps {

/// Problems of a file as callers of the library get them.
[[nodiscard]] std::vector<JobProblem> problem_list(const std::vector<Problem>& problems,
                                                   const std::filesystem::path& source);

}  // namespace orbid::apps
