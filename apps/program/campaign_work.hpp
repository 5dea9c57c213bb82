#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

#include "apps/campaign/engine/campaign_run.hpp"

namespace orbid::apps {

/// Runs the job of a task in one thread, without files.
[[nodiscard]] TaskRun run_task(const std::string& text, const std::filesystem::path& source,
                               const std::function<bool()>& stopped);

/// The journal of a campaign in a folder, for writing. Of a damaged one what is whole is kept and the rest waits again,
/// which `messages` is told.
/// @throws OtherCampaign, JournalError
[[nodiscard]] Journal whole_journal(const CampaignTasks& tasks, const std::filesystem::path& folder,
                                    std::ostream& messages);
/// The journal that a folder holds.
[[nodiscard]] Journal whole_journal(const std::filesystem::path& folder, std::ostream& messages);

/// The campaign that a journal says it is of.
[[nodiscard]] CampaignTasks tasks_of(const Journal& journal);

/// How the waiting tasks of a journal were run.
struct WaitingRun {
    int exit_code = 0;
    std::string status;  ///< how the campaign stands now, as text
};

/// Runs what waits in a journal, and keeps the report of its folder up to date.
[[nodiscard]] WaitingRun run_waiting(const CampaignTasks& tasks, Journal& journal, const CampaignOptions& options,
                                     const DealerCalls& calls);

/// Exit code of `work`. Refusals of a journal, of another campaign or of MPI are told instead of thrown.
[[nodiscard]] int refusals_told(const std::function<void(const std::string&)>& tell, const std::function<int()>& work);

}  // namespace orbid::apps
