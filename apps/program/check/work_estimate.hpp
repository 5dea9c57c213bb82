#pragma once

#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/program/check/data_check.hpp"

namespace orbid::apps {

/// The approximate work of a stage.
struct StageWork {
    std::string stage;
    std::string amount;      ///< of what: "1048576 sections"
    double megabytes = 0.0;  ///< of its large arrays
    double seconds = 0.0;    ///< with the requested threads
};

/// Work and memory of every stage of a job, from the numbers in it and rates measured once, without running anything.
/// Memory is that of the large arrays, good to a factor of two where records decide it. Times are good to a factor of
/// five for most jobs (docs/command_line.md compares them with runs). They only distinguish seconds from hours: the
/// cycles of a search and the steps of a minimisation are not known beforehand.
///
/// @param data     what the job's files hold.
/// @param threads  >= 1.
[[nodiscard]] std::vector<StageWork> estimated_work(const Job& job, const DataCheck& data, int threads);

/// A table of it, for standard output; empty without stages.
[[nodiscard]] std::string work_table(const std::vector<StageWork>& work, int threads);

}  // namespace orbid::apps
