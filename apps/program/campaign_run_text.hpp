#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/program/job_run.hpp"

#pragma GCC visibility push(default)

namespace orbid::apps {

/// Where a campaign is run, and by whom.
struct CampaignRunOptions {
    std::filesystem::path out;  ///< folder of the journal, campaign.sqlite, and the report
    int threads = 0;            ///< tasks at the same time; 0: one per core. Results do not depend on it
    bool processes = false;  ///< each in a process of its own, which may crash alone: for programs with one thread, as
                             ///< forking is undefined with more
    bool retry = false;      ///< failed tasks wait again first
};

/// How many tasks there are, and how they stand.
struct CampaignTaskCounts {
    std::int64_t tasks = 0;
    std::int64_t waiting = 0;  ///< those in work included
    std::int64_t done = 0;     ///< ended with a result, valid or not
    std::int64_t failed = 0;   ///< ended without one
};

/// How far a running campaign is.
struct CampaignRunProgress {
    CampaignTaskCounts counts;
    std::int64_t in_work = 0;
    double seconds = 0.0;    ///< since the call
    double remaining = 0.0;  ///< [s] expected from what tasks have taken; nan: nothing is known yet
};

/// What a running campaign asks and tells its caller, in the calling thread, at most ten times a second.
struct CampaignRunCalls {
    std::function<bool()> stopped;  ///< true: leave; tasks that have ended are stored, the others wait
    std::function<void(const CampaignRunProgress& progress)> progress;
};

/// What became of a campaign; everything else is in the journal (docs/campaigns.md).
struct CampaignRun {
    int exit_code = 0;  ///< that of the command line: 0; 1 no task gave a result; 2, 3 problems; 4 journal; 130 stopped
    std::vector<JobProblem> problems;  ///< why the campaign cannot be run: nothing else is meaningful then
    std::string summary;               ///< what the command line prints: how the campaign stands
    std::string messages;              ///< lines of standard error: why a journal is refused, what of it is mended
    CampaignTaskCounts counts;
};

/// Runs the waiting tasks of a campaign given as text, without printing or catching signals. The same call goes on with
/// one that was stopped or killed.
/// @param text    JSON with comments, as in a campaign file.
/// @param source  path of the campaign file, which need not exist: relative paths in it start at its folder.
/// @throws std::invalid_argument without a folder or with threads < 0; std::runtime_error when files cannot be written
///         or all that compute are lost; what `calls` threw, once the tasks in work have stopped.
[[nodiscard]] CampaignRun run_campaign_text(std::string_view text, const std::filesystem::path& source,
                                            const CampaignRunOptions& options, const CampaignRunCalls& calls = {});

/// The job of a task.
struct CampaignTaskJob {
    std::string text;              ///< as run_job_text() takes it
    std::filesystem::path source;  ///< likewise: relative paths in the job start at its folder
};

/// The job of a task of the campaign in a folder.
/// @param number  from 0.
/// @throws std::invalid_argument when there is no such task; std::runtime_error when the folder holds no journal that
///         can be read.
[[nodiscard]] CampaignTaskJob campaign_task_job(const std::filesystem::path& folder, std::int64_t number);

}  // namespace orbid::apps

#pragma GCC visibility pop
