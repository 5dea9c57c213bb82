#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// Records of one coordinate of an experiment, by segment or cycle, in the order of the file.
struct RecordGroup {
    using Rows = std::vector<const ResidualRow*>;

    std::string experiment;
    std::string coordinate;
    std::vector<std::pair<std::string, Rows>> blocks;
    bool cycles = false;
    std::string place = "time or phase";  ///< what residuals.csv counts along
    std::string place_unit = {};
    std::string unit = {};  ///< of the coordinate
    std::string label = {};
};

/// The residual over the sd of its error; nan where that is not known.
[[nodiscard]] double over_sd(const ResidualRow& row);

/// Rows that a chart carries; of more, every k-th of a group. 2^18 are some 3 MB of a page.
inline constexpr std::size_t most_rows = std::size_t{1} << 18;

/// @param rows  residuals.csv of the run; they must outlive the groups.
/// @param most  rows of all groups together; of more, every k-th of a group
[[nodiscard]] std::vector<RecordGroup> record_groups(const StoredRun& run, const std::vector<ResidualRow>& rows,
                                                     std::size_t most = most_rows);

/// Residuals over their sd, record by record.
[[nodiscard]] Chart residual_chart(const std::vector<RecordGroup>& groups);
/// Sorted residuals over the quantiles of the normal distribution: (k - 0.5) / n.
[[nodiscard]] Chart quantile_chart(const std::vector<RecordGroup>& groups);
/// Observed and predicted values: over time, or of cycles against each other.
[[nodiscard]] Chart prediction_chart(const std::vector<RecordGroup>& groups);
/// Measured and computed steady states over one turn of the orbit.
[[nodiscard]] Chart waveform_chart(const StoredRun& run, const std::vector<ResidualRow>& rows);

}  // namespace orbid::apps
