#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/campaign/engine/resampled_data.hpp"
#include "apps/campaign/journal/task_outcome.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"

namespace orbid::apps {

/// What running a job gave.
struct TaskRun {
    int exit_code = 0;     ///< that of `orbid run`
    std::string problems;  ///< why the job cannot be run; empty: it was
    std::string messages;  ///< lines of standard error
    std::string result;    ///< content of result.json; empty: none
};

/// Runs a job in this thread; may be called by several threads. What it throws fails the task.
/// @param source   relative paths in the job start at its folder.
/// @param stopped  true: stop at the next step with the best result so far.
using TaskRunner = std::function<TaskRun(const std::string& text, const std::filesystem::path& source,
                                         const std::function<bool()>& stopped)>;

/// Runs the tasks of a campaign, one after the other, in one thread.
class TaskWork {
public:
    /// @param rank  noted with each outcome.
    /// @throws std::runtime_error when data are to be drawn anew from a run that has no residuals.
    TaskWork(const CampaignTasks& tasks, const TaskRunner& runner, int rank);

    /// @param stopped  the campaign is to stop: the outcome's state is then `waiting`, and nothing else of it counts.
    [[nodiscard]] TaskOutcome run(std::int64_t number, const std::function<bool()>& stopped) const;

private:
    [[nodiscard]] const std::vector<KnownValue>& known_values(const std::string& job, std::int64_t number) const;
    [[nodiscard]] TaskRun run_resampled(const std::string& job, std::int64_t number,
                                        const std::function<bool()>& stopped) const;

    const CampaignTasks& tasks_;
    const TaskRunner& runner_;
    int rank_;
    std::string host_;
    std::optional<ResampledData> resampled_;
    bool drawn_;  ///< each replicate may have a truth of its own
    mutable std::int64_t known_group_ = -1;
    mutable std::vector<KnownValue> known_;  ///< of that group
};

/// What result.json says, put into an outcome.
void take_result(std::string_view text, TaskOutcome& outcome);

/// The values that made the data of a job, by name of its estimated parameters; else its "reference". Nothing of a job
/// that cannot be read.
[[nodiscard]] std::vector<KnownValue> known_in_job(const std::string& text, const std::filesystem::path& source);

}  // namespace orbid::apps
