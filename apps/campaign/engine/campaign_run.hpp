#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include "apps/campaign/engine/dealer.hpp"
#include "apps/campaign/engine/task_run.hpp"
#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/plan/campaign.hpp"

namespace orbid::apps {

/// Who computes. automatic: the ranks that MPI has started, else processes.
enum class Engine { automatic, processes, threads };
inline const std::vector<std::string> engine_names{"auto", "processes", "threads"};

struct CampaignOptions {
    std::filesystem::path out;  ///< folder of the journal and the report
    int ranks = 0;              ///< that compute; 0: one per core. Not asked with ranks that are given
    Engine engine = Engine::automatic;
    estimator::Ranks* given = nullptr;  ///< this is rank 0 of them
};

/// A folder holds the journal of another campaign; what() names where they differ.
class OtherCampaign : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

inline constexpr const char* journal_name = "campaign.sqlite";

/// What decides the tasks of a campaign and their results, data files included, as SHA-256.
/// @throws std::runtime_error when a data file cannot be read.
[[nodiscard]] std::string campaign_key(const CampaignTasks& tasks);

/// The journal of a campaign in a folder: a new one with all its tasks, or the one that is there.
/// @throws OtherCampaign, JournalError; std::runtime_error when the folder cannot be made or a data file not be read.
[[nodiscard]] Journal campaign_journal(const CampaignTasks& tasks, const std::filesystem::path& folder);

/// Adds the tasks that a journal lacks: the adding was interrupted, or they were lost with a damaged part.
void add_missing_tasks(const CampaignTasks& tasks, Journal& journal);

/// Runs all waiting tasks of a journal.
/// @return false: stopped before the end; what has ended is stored.
/// @throws JournalError, std::runtime_error as Dealer::run.
[[nodiscard]] bool run_campaign(const CampaignTasks& tasks, Journal& journal, const CampaignOptions& options,
                                const TaskRunner& runner, const DealerCalls& calls);

}  // namespace orbid::apps
