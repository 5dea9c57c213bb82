#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// `orbid plot DIR [NAME]`: lists the plots, or writes one as a file.
/// @return 0; 2 for a wrong folder or name, or a missing converter; 3 when a stored file cannot be read.
[[nodiscard]] int plot_run(const CommandCall& call);

/// `orbid predict DIR DATA`: predicts a further record with the estimate of a run. Results go to DIR/predict_NAME or
/// --out, tables to standard output. Exit codes as plot_run.
[[nodiscard]] int predict_run(const CommandCall& call);

/// `orbid compare DIR DIR`: two results side by side. Exit codes as plot_run; 2 also for results that cannot be
/// compared.
[[nodiscard]] int compare_runs(const CommandCall& call);

/// Runs a command on stored files; reports their problems on standard error and then returns 2 or 3.
[[nodiscard]] int with_stored_files(const CommandCall& call, const std::function<int()>& command);

/// Formats of plots.
[[nodiscard]] std::vector<std::string> plot_formats();

}  // namespace orbid::apps
