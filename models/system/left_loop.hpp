#pragma once

#include <oneapi/tbb/task_group.h>

#include "models/system/stopped.hpp"

namespace orbid::models {

/// After a parallel loop that may run within another one. When an exception leaves the other, TBB ends this one early
/// and returns as if it were done: not all of its slots are filled.
/// @throws Stopped then
inline void stop_if_left() {
    if (oneapi::tbb::is_current_task_group_canceling()) throw Stopped();
}

}  // namespace orbid::models
