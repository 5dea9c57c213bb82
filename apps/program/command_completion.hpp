#pragma once

#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// Shells with completion: bash, zsh.
[[nodiscard]] std::vector<std::string> completion_shells();

/// A script with a shell's completion of all commands: their options with choices, names of models, jobs (*.json) and
/// folders.
/// @throws std::invalid_argument for another shell.
[[nodiscard]] std::string completion_script(const std::string& shell);

/// orbid completion bash|zsh: the script on standard output.
[[nodiscard]] int show_completion(const CommandCall& call);

}  // namespace orbid::apps
