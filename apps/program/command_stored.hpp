#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// `orbid plot DIR [NAME]`: the plots there are, or one of them as a file.
/// @return 0; 2 for a wrong folder or name, or a converter that is missing; 3 when a stored file cannot be read.
[[nodiscard]] int plot_run(const CommandCall& call);

/// `orbid predict DIR DATA`: how well the estimate of a run predicts a further record; stored in DIR/predict_NAME or
/// --out, tables on standard output. Exit codes as plot_run.
[[nodiscard]] int predict_run(const CommandCall& call);

/// `orbid compare DIR DIR`: two results beside each other. Exit codes as plot_run; 2 also for what is not comparable.
[[nodiscard]] int compare_runs(const CommandCall& call);

/// Runs a command on stored files; says on standard error what is wrong with them, and returns 2 or 3 then.
[[nodiscard]] int with_stored_files(const CommandCall& call, const std::function<int()>& command);

/// Formats that plots are written in.
[[nodiscard]] std::vector<std::string> plot_formats();

}  // namespace orbid::apps
