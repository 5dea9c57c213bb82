#pragma once

#include <functional>

#include "apps/program/console.hpp"

namespace orbid::apps {

/// Calls `compute` with a limit on the threads that its loops take: of the whole process where that is there for this
/// command or takes its signals from the terminal, else of this call alone.
/// @param threads  0: no limit.
/// @return what `compute` returns.
int with_thread_limit(int threads, const Console& console, const std::function<int()>& compute);

}  // namespace orbid::apps
