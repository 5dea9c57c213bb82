#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// What the files that a job names hold.
struct DataCheck {
    struct Record {
        std::size_t points = 0;
        std::size_t segments = 0;
    };
    /// One per experiment; nothing for those that are simulated, and for files that cannot be used.
    std::vector<std::optional<Record>> records;
    std::optional<std::size_t> cycles;  ///< of the file that "orbits" names
    /// Messages with file and, in tables, line and column: what `orbid run` would end with. Several files have one
    /// each.
    std::vector<std::string> problems;
};

/// Reads every file that the job names as a run would, and looks whether the series of the estimate can be made from
/// them: columns, rows, times, segments asked for, enough readings. Nothing is computed.
[[nodiscard]] DataCheck check_data(const Job& job);

}  // namespace orbid::apps
