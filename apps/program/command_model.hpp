#pragma once

#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// orbid models [NAME]: all models on standard output, or the page of one.
/// @throws CommandLineError when there is no such model.
[[nodiscard]] int show_models(const CommandCall& call);

/// orbid new MODEL [TASK]: a commented starting job on standard output; without TASK "simulate". orbid new campaign
/// [KIND]: a campaign; without KIND "sweep".
/// @throws CommandLineError when there is no such model, task or kind, or the model cannot do it.
[[nodiscard]] int show_starting_job(const CommandCall& call);
/// What its two words may be.
[[nodiscard]] std::vector<std::string> starting_subjects();
[[nodiscard]] std::vector<std::string> starting_purposes();

}  // namespace orbid::apps
