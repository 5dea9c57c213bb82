#pragma once

#include <iosfwd>

#include "apps/program/command.hpp"
#include "apps/results/output_folder.hpp"

namespace orbid::apps {

/// `orbid report DIR`: writes DIR/report.html anew from the files there.
/// @return 0; 2 when DIR is no output folder; 3 when a file in it cannot be read.
[[nodiscard]] int write_report(const CommandCall& call);

/// Stores report.html of a finished run beside its results. `complaints` tells what cannot be reported; the stored
/// results stay valid.
void store_report(OutputFolder& folder, std::ostream& complaints);

}  // namespace orbid::apps
