#pragma once

#include <string>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::apps {

/// The program: one command with its options.
/// @param arguments    without the program's own name.
/// @param own_process  the process is there for this command alone: an interrupted run may end it, see Departure.
/// @return exit code: 0 done, 1 done without a valid answer, 2 wrong command line or job, 3 data cannot be used,
///         130 interrupted.
[[nodiscard]] int run_command(const std::vector<std::string>& arguments, bool own_process = false);

}  // namespace orbid::apps

#pragma GCC visibility pop
