#pragma once

#include <vector>

#include "apps/estimation/estimate_stage.hpp"
#include "apps/job/job.hpp"
#include "apps/program/console.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/workspace.hpp"

namespace orbid::apps {

/// Whether a command runs this stage.
[[nodiscard]] bool wants(const RunOptions& options, Stage stage);

/// Whether cycles are searched for, not read from a file.
[[nodiscard]] bool is_section_search(const Job& job);

/// The stage of cycles: their list, what it tells, and a picture of the section.
/// @throws orbits::DataError, StaleFile as load_cycles() does.
[[nodiscard]] JobCycles job_cycles(const Workspace& work, const std::vector<Experiment>& data, const Console& console);

/// The same for an estimate that has come to need cycles. It goes on without, where the record cannot be searched.
void find_needed_cycles(const Workspace& work, const std::vector<Experiment>& data, const Console& console,
                        JobCycles& cycles);

/// Stores a picture of the section that was not searched.
void store_section(const Workspace& work, const std::vector<Experiment>& data);

}  // namespace orbid::apps
