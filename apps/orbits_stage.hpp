#pragma once

#include <vector>

#include "apps/cycle_file.hpp"
#include "apps/data_stage.hpp"
#include "apps/workspace.hpp"

namespace orbid::apps {

/// What stands above every list of cycles or orbits of this job.
[[nodiscard]] CycleFileHead cycle_file_head(const Job& job, Fingerprint fingerprint);

/// The cycles of the job: read from its file, searched in the series and stored as cycles.json, or taken from there
/// while its fingerprint fits. Periods that were asked for and not found are said.
///
/// @throws orbits::DataError when the list cannot be read or the series is too short, StaleFile as reusable() does.
[[nodiscard]] orbits::CycleSearch load_cycles(const Workspace& work, const std::vector<Experiment>& data);

}  // namespace orbid::apps
