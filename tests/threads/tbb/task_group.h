#pragma once

#include "crew.h"

namespace tbb {

/// An exception that leaves a loop here ends no loops within the other pieces of it: all of their slots are filled.
inline bool is_current_task_group_canceling() { return false; }

}  // namespace tbb
