#pragma once

#include <string>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// What a job would run: stages in order, points, memory of the series, free parameters.
[[nodiscard]] std::string job_summary(const Job& job);

}  // namespace orbid::apps
