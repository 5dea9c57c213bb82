#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::apps {

/// Runs one command of the program with its options, on the streams of this process. Ctrl-C and SIGTERM stop a run.
/// @param arguments    without the program's own name.
/// @param own_process  the process serves this command only: --threads is for the whole process.
/// @return exit code: 0 done, 1 done without a valid answer, 2 wrong command line or job, 3 data cannot be used,
///         130 interrupted.
[[nodiscard]] int run_command(const std::vector<std::string>& arguments, bool own_process = false);

/// The same for programs that take the texts themselves or call from several threads. Nothing is written to the streams
/// of the process, and no signals are caught.
/// @param stopped  called between the steps of a run, from several threads; empty: never stop.
/// @throws std::runtime_error when files cannot be written.
[[nodiscard]] int run_command(const std::vector<std::string>& arguments, std::ostream& out, std::ostream& error,
                              const std::function<bool()>& stopped = {});

}  // namespace orbid::apps

#pragma GCC visibility pop
