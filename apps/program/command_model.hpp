#pragma once

#include "apps/program/command.hpp"

namespace orbid::apps {

/// orbid models [NAME]: all models on standard output, or the page of one.
/// @throws CommandLineError when there is no such model.
[[nodiscard]] int show_models(const CommandCall& call);

/// orbid new MODEL [TASK]: a commented starting job on standard output; without TASK "simulate".
/// @throws CommandLineError when there is no such model or task, or the model cannot do it.
[[nodiscard]] int show_starting_job(const CommandCall& call);

}  // namespace orbid::apps
