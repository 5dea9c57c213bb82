#pragma once

#include <string>

#include "apps/command.hpp"

namespace orbid::apps {

/// The words of a command as its usage shows them: "MODEL [TASK]".
[[nodiscard]] std::string usage_words(const Command& command);

/// All commands, exit codes; what `orbid --help` prints.
[[nodiscard]] std::string program_help();

/// One command: usage, words with their choices, options, examples; what `orbid COMMAND --help` prints.
[[nodiscard]] std::string command_help(const Command& command);

}  // namespace orbid::apps
