#pragma once

#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// All commands, one row each, in the order of the help. Parser, help, completion and man page are made from them.
[[nodiscard]] const std::vector<Command>& command_table();

/// Options of every command.
[[nodiscard]] const std::vector<CommandOption>& common_options();
/// The options of a command and those of every command.
[[nodiscard]] std::vector<CommandOption> all_options(const Command& command);

}  // namespace orbid::apps
