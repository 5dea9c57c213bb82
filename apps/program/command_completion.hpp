#pragma once

#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// Shells that completion is written for: bash, zsh.
[[nodiscard]] std::vector<std::string> completion_shells();

/// A script that teaches a shell the commands of the table: their options with the choices of each, names of models,
/// jobs (*.json) and folders.
/// @throws std::invalid_argument for another shell.
[[nodiscard]] std::string completion_script(const std::string& shell);

/// orbid completion bash|zsh: the script on standard output.
[[nodiscard]] int show_completion(const CommandCall& call);

}  // namespace orbid::apps
