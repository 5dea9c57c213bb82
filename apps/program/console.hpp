#pragma once

#include <cstdio>
#include <functional>
#include <iosfwd>
#include <string_view>

namespace orbid::apps {

/// Where a command writes, and what may stop it.
struct Console {
    std::ostream& out;                  ///< summary tables, what was asked for
    std::ostream& error;                ///< messages and progress
    std::FILE* out_terminal = nullptr;  ///< the file behind `out` where that may be a terminal
    std::FILE* error_terminal = nullptr;
    bool signals = false;  ///< Ctrl-C and SIGTERM ask a run to stop; one such run at a time
    /// The process is there for this command alone: asked to stop, a run may end it where a computation cannot be
    /// stopped; the number of threads is that of the whole process.
    bool own_process = false;
    std::function<bool()> stopped = {};  ///< asked between steps, by several threads; empty: never

    /// Whether `out` or `error` is coloured, given the value of --color; "auto": on terminals.
    [[nodiscard]] bool colours_out(std::string_view choice = "auto") const;
    [[nodiscard]] bool colours_error(std::string_view choice = "auto") const;
};

/// The streams and signals of this process.
[[nodiscard]] Console standard_console(bool own_process = false);

}  // namespace orbid::apps
