#pragma once

#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// All commands, in the order in which help shows them. One row each: parser, help, completion and man page are made
/// from it.
[[nodiscard]] const std::vector<Command>& command_table();

/// Options that every command has.
[[nodiscard]] const std::vector<CommandOption>& common_options();

}  // namespace orbid::apps
