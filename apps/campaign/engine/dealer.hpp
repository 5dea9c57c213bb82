#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "apps/campaign/engine/crew.hpp"
#include "apps/campaign/engine/task_queue.hpp"
#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"

namespace orbid::apps {

/// How far a campaign is.
struct CampaignProgress {
    std::int64_t tasks = 0;
    std::int64_t done = 0;
    std::int64_t failed = 0;
    std::int64_t in_work = 0;
    int ranks = 0;           ///< that compute
    double seconds = 0.0;    ///< since this command began
    double remaining = 0.0;  ///< [s] expected from what tasks have taken; nan: nothing is known yet
};

struct DealerCalls {
    std::function<bool()> stopped;                                   ///< leave, with what is stored
    std::function<void(const CampaignProgress& progress)> progress;  ///< now and then, at most ten times a second
    std::function<void()> before_fork;  ///< a process is to be forked: the caller ends its threads
};

/// Rank 0 of a campaign: deals waiting tasks, stores what comes back, until none waits or it is stopped. Outcomes that
/// have arrived together are stored together; a task is lost only if its outcome has not been stored. A task whose rank
/// crashes has failed; one whose rank is killed is dealt again, up to three times.
class Dealer {
public:
    Dealer(const CampaignTasks& tasks, Journal& journal, Crew& crew, DealerCalls calls);

    /// @return false: stopped before the end.
    /// @throws std::runtime_error when no rank is left that computes, or one cannot take up the campaign; JournalError.
    [[nodiscard]] bool run();

private:
    struct Rank {
        std::deque<std::int64_t> dealt;               ///< not yet ended, in their order; the first one is in work
        std::chrono::steady_clock::time_point since;  ///< the first one is in work
        bool gone = false;
    };

    void greet(int rank);
    void deal();
    void deal_to(int rank, std::size_t most);
    [[nodiscard]] std::size_t ahead() const;
    void take(const estimator::RankMessage& message);
    void lose(int rank);
    void store();
    void kill_late();
    void tell();
    [[nodiscard]] std::int64_t in_work() const;
    [[nodiscard]] int computing() const;
    [[nodiscard]] double remaining() const;

    const CampaignTasks& tasks_;
    Journal& journal_;
    Crew& crew_;
    DealerCalls calls_;
    TaskQueue queue_;
    std::vector<Rank> ranks_;  ///< by rank; 0 is this one
    std::vector<TaskOutcome> arrived_;
    std::map<std::int64_t, int> kills_;  ///< of ranks that had this task in work
    JournalCounts counts_;
    std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
    std::chrono::steady_clock::time_point told_;
    double task_seconds_ = 0.0;  ///< mean of the last tasks
};

}  // namespace orbid::apps
