#pragma once

#include <string>
#include <vector>

#include "apps/command.hpp"

namespace orbid::apps {

/// `orbid plot DIR [NAME]`: the plots there are, or one of them as a file.
/// @return 0; 2 for a wrong folder or name, or a converter that is missing; 3 when a stored file cannot be read.
[[nodiscard]] int plot_run(const CommandCall& call);

/// Formats that plots are written in.
[[nodiscard]] std::vector<std::string> plot_formats();

}  // namespace orbid::apps
