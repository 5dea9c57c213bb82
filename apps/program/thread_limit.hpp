#pragma once

#include <functional>

#include "apps/program/console.hpp"

namespace orbid::apps {

/// Calls `compute` with a limit on the threads of its loops. The limit is for the whole process if that serves this
/// command only or takes its signals from the terminal, else for this call.
/// @param threads  0: no limit.
/// @return what `compute` returns.
int with_thread_limit(int threads, const Console& console, const std::function<int()>& compute);

}  // namespace orbid::apps
