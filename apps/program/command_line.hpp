#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::apps {

/// The program: one command with its options, on the streams of this process; Ctrl-C and SIGTERM stop a run.
/// @param arguments    without the program's own name.
/// @param own_process  the process is there for this command alone: an interrupted run may end it, see Departure.
/// @return exit code: 0 done, 1 done without a valid answer, 2 wrong command line or job, 3 data cannot be used,
///         130 interrupted.
[[nodiscard]] int run_command(const std::vector<std::string>& arguments, bool own_process = false);

/// The same for a program that wants the texts itself, or calls it from several threads: nothing is written to the
/// streams of the process, no signals are caught.
/// @param stopped  asked between the steps of a run, by several threads; empty: never.
/// @throws std::runtime_error when files cannot be written.
[[nodiscard]] int run_command(const std::vector<std::string>& arguments, std::ostream& out, std::ostream& error,
                              const std::function<bool()>& stopped = {});

}  // namespace orbid::apps

#pragma GCC visibility pop
