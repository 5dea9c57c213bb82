#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/tables/group_statistics.hpp"

namespace orbid::apps {

/// The tables that there are.
enum class CampaignTable { tasks, parameters, summary };
/// As commands call them, in the order of CampaignTable.
inline const std::vector<std::string> campaign_table_names{"tasks", "parameters", "summary"};

struct TableOptions {
    CampaignTable table = CampaignTable::tasks;
    bool times = false;  ///< attempts, host, rank, started, seconds, processor_seconds as well
    /// Asked all along; stops with models::Stopped when it says so.
    std::function<bool()> interrupted = {};
};

/// CSV (RFC 4180, lines end in LF): numbers read back to the bit, undefined ones are empty cells. Without `times` a
/// table depends on the campaign and the results alone: the same bytes whatever ran it. A column of what varies whose
/// name another column has is called NAME_varied.
///
/// tasks: one row for each task: number, what varies, state, status, exit_code, objective; for each parameter NAME,
/// NAME_sd, NAME_lower, NAME_upper, and NAME_truth, NAME_bound where a task has them; message.
///
/// parameters: one row for each task and parameter: number, what varies, status, parameter, value, sd, lower, upper,
/// truth, bound. Tasks without parameters have none.
///
/// summary: one row for each setting, replicates together: what varies, tasks, done, converged, valid, failed; for each
/// parameter NAME_count, NAME_mean, NAME_sd (spread of the estimates), NAME_mean_sd (as reported), and with truths
/// NAME_rms_z, NAME_coverage, NAME_coverage_lower, NAME_coverage_upper, with bounds NAME_rms_over_bound. Statistics are
/// of valid tasks (is_valid). `times` adds mean_seconds alone.
/// @throws JournalDamaged; std::runtime_error when the stream takes no more.
void write_campaign_table(const Journal& journal, std::ostream& out, const TableOptions& options = {});

/// A value of what varies as a cell: texts without their quotes, everything else as JSON.
[[nodiscard]] std::string varied_text(const std::string& json);

}  // namespace orbid::apps
