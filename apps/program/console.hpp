#pragma once

#include <cstdio>
#include <functional>
#include <iosfwd>

namespace orbid::apps {

/// The outputs of a command, and what may stop it.
struct Console {
    std::ostream& out;                  ///< summary tables, requested output
    std::ostream& error;                ///< messages and progress
    std::FILE* out_terminal = nullptr;  ///< the file of `out` if that may be a terminal
    std::FILE* error_terminal = nullptr;
    bool signals = false;  ///< Ctrl-C and SIGTERM request a stop; one such run at a time
    /// The process serves this command only: the number of threads is that of the whole process.
    bool own_process = false;
    std::function<bool()> stopped = {};  ///< called between steps, from several threads; empty: never stop
};

/// The streams and signals of this process.
[[nodiscard]] Console standard_console(bool own_process = false);

/// Calls `compute` with a limit on the threads of its loops. The limit is for the whole process if that serves this
/// command only or takes its signals from the terminal, else for this call.
/// @param threads  0: no limit.
/// @return what `compute` returns.
int with_thread_limit(int threads, const Console& console, const std::function<int()>& compute);

}  // namespace orbid::apps
