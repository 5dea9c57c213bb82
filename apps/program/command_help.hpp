#pragma once

#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// The words of a command as in its usage: "MODEL [TASK]".
[[nodiscard]] std::string usage_words(const Command& command);

/// A meaning with what may be chosen: "shells: bash, zsh".
[[nodiscard]] std::string with_choices(const std::string& meaning, std::vector<std::string> (*choices)());

/// All commands, exit codes; what `orbid --help` prints.
[[nodiscard]] std::string program_help();

/// One command: usage, words with their choices, options, examples; what `orbid COMMAND --help` prints.
[[nodiscard]] std::string command_help(const Command& command);

/// An exit code of the program.
struct ExitCode {
    int code;
    std::string meaning;
};
[[nodiscard]] const std::vector<ExitCode>& exit_codes();

/// An environment variable of the program.
struct EnvironmentVariable {
    std::string name;
    std::string meaning;
};
[[nodiscard]] const std::vector<EnvironmentVariable>& environment_variables();

/// What Ctrl-C does, and how a run is continued.
[[nodiscard]] std::string signals_text();

/// orbid help [COMMAND]: the overview, or the help of a command, on standard output.
/// @throws CommandLineError when there is no such command.
[[nodiscard]] int show_help(const CommandCall& call);

/// Names of all commands that can be called.
[[nodiscard]] std::vector<std::string> command_names();

}  // namespace orbid::apps
