#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace orbid::apps {

/// A C++ compiler on this machine.
struct Compiler {
    std::filesystem::path path;  ///< absolute
    std::string identity;        ///< path, size and time of the program behind all links: differs between compilers
};

/// $ORBID_CXX if set (a program, without options; empty: no compiler), else the compiler that built orbid, else the
/// first c++ in $PATH.
[[nodiscard]] std::optional<Compiler> find_compiler();

/// How a program ended.
struct ProgramEnd {
    bool started = false;
    bool timed_out = false;
    int exit_code = -1;  ///< 0 success; -1 when it was killed
    [[nodiscard]] bool succeeded() const { return started && !timed_out && exit_code == 0; }
};

/// Runs a program with these arguments (the first after its name), never through a shell, so arguments are not
/// interpreted. It gets no input; its output goes to a file.
///
/// @param temporary  folder for its temporary files
/// @param seconds    time limit; then it is killed
[[nodiscard]] ProgramEnd run_program(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                                     const std::filesystem::path& printed, const std::filesystem::path& temporary,
                                     double seconds);

}  // namespace orbid::apps
