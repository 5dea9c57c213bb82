#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "apps/program/command.hpp"
#include "apps/results/output_folder.hpp"

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

/// `orbid report DIR`: writes DIR/report.html anew from the files there.
/// @return 0; 2 when DIR is no output folder; 3 when a file in it cannot be read.
[[nodiscard]] int write_report(const CommandCall& call);

/// Stores report.html of a finished run beside its results. `complaints` tells what cannot be reported; the stored
/// results stay valid.
/// @param stopped  asked while records are read
/// @throws models::Stopped
void store_report(OutputFolder& folder, std::ostream& complaints, const std::function<bool()>& stopped = {});

/// Formats of plots.
[[nodiscard]] std::vector<std::string> plot_formats();

}  // namespace orbid::apps
