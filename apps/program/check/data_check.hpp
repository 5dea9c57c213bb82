#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/stages/data_stage.hpp"

namespace orbid::apps {

/// The content of the files that a job names.
struct DataCheck {
    struct Record {
        std::size_t points = 0;
        std::size_t segments = 0;
    };
    /// One per experiment; nothing for simulated ones and for unusable files.
    std::vector<std::optional<Record>> records;
    std::vector<Experiment> experiments;  ///< as they were read, one per experiment
    std::optional<std::size_t> cycles;    ///< of the file named by "orbits"
    /// Messages with file and, in tables, line and column: what `orbid run` would end with. Each file has its own.
    std::vector<std::string> problems;
    std::vector<std::string> remarks;  ///< what the readings of the estimate cannot determine
};

/// Reads every file that the job names as a run would, and checks whether they give the series of the estimate:
/// columns, rows, times, requested segments, enough readings, and what these can determine. Nothing is estimated.
[[nodiscard]] DataCheck check_data(const Job& job);

}  // namespace orbid::apps
