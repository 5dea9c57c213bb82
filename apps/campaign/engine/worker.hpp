#pragma once

#include "apps/campaign/engine/task_run.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::apps {

/// A rank that computes: takes the campaign from rank 0, then tasks, until it is told to stop or rank 0 has ended.
/// @return exit code of its process: 0, or 1 when it cannot take the campaign up.
int serve_tasks(estimator::Ranks& ranks, const TaskRunner& runner);

}  // namespace orbid::apps
