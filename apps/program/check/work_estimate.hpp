#pragma once

#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/program/check/data_check.hpp"
#include "apps/program/check/flow_rate.hpp"

namespace orbid::apps {

/// The approximate work of a stage.
struct StageWork {
    std::string stage;
    std::string amount;      ///< of what: "1048576 sections"
    double megabytes = 0.0;  ///< of its large arrays
    double seconds = 0.0;    ///< with the requested threads; nan: unknown
    std::string unknown{};   ///< why, as half a sentence; empty: known
};

/// Work and memory of every stage of a job. Times rest on the numbers in it, on the measured rates of its model, and on
/// how many evaluations minimisations take. They are good to a factor of three (docs/command_line.md compares them with
/// runs); where one cannot be known beforehand the stage says why. Memory is that of the large arrays, good to a factor
/// of two where records decide it.
///
/// @param data     what the job's files hold.
/// @param threads  >= 1.
/// @param rates    of the experiments, see measured_rates(); empty, or an entry without numbers: those of a pendulum.
[[nodiscard]] std::vector<StageWork> estimated_work(const Job& job, const DataCheck& data, int threads,
                                                    const std::vector<FlowRate>& rates = {});

/// A table of it, for standard output; empty without stages.
[[nodiscard]] std::string work_table(const std::vector<StageWork>& work, int threads);

}  // namespace orbid::apps
