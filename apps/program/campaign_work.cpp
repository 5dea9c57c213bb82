#include "apps/program/campaign_work.hpp"

#include <ostream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/campaign/report/campaign_report.hpp"
#include "apps/campaign/tables/campaign_status.hpp"
#include "apps/program/command.hpp"
#include "apps/program/job_run.hpp"
#include "apps/ranks/rank_plugin.hpp"

namespace orbid::apps {

namespace {

/// Keeps what is whole of a damaged journal; the rest waits again.
void recover(const std::filesystem::path& file, const JournalDamaged& damage, std::ostream& messages) {
    RecoveredJournal found;
    try {
        found = Journal::recover(file);
    } catch (const JournalError& error) {
        // SQLite says nothing of some failures of the disk: then it only seems to be damaged.
        throw JournalError(
            fmt::format("{}; {}. Nothing was changed: try again if the disk could not be read just now, "
                        "or begin the campaign in another folder",
                        damage.what(), error.what()));
    }
    messages << fmt::format(
        "{}\n{} of {} tasks are whole, the others wait again ({} had ended); the damaged file is kept as {}\n",
        damage.what(), found.ended, found.tasks, found.lost_outcomes, found.damaged.string());
}

}  // namespace

TaskRun run_task(const std::string& text, const std::filesystem::path& source, const std::function<bool()>& stopped) {
    RunOptions options;
    options.threads = 1;
    options.quiet = true;
    options.in_memory = true;
    JobRunCalls calls;
    calls.stopped = stopped;
    const JobRun run = run_job_text(text, source, options, calls);
    TaskRun task{run.exit_code, {}, run.messages, run.result};
    for (const JobProblem& problem : run.problems)
        task.problems += fmt::format("{}{}{}\n", problem.pointer, problem.pointer.empty() ? "" : ": ", problem.rule);
    return task;
}

Journal whole_journal(const CampaignTasks& tasks, const std::filesystem::path& folder, std::ostream& messages) {
    try {
        return campaign_journal(tasks, folder);
    } catch (const JournalDamaged& damage) {
        recover(folder / journal_name, damage, messages);
        return campaign_journal(tasks, folder);
    }
}

Journal whole_journal(const std::filesystem::path& folder, std::ostream& messages) {
    const std::filesystem::path file = folder / journal_name;
    try {
        return Journal::open(file, Journal::Access::write);
    } catch (const JournalDamaged& damage) {
        recover(file, damage, messages);
        Journal journal = Journal::open(file, Journal::Access::write);
        add_missing_tasks(tasks_of(journal), journal);
        return journal;
    }
}

CampaignTasks tasks_of(const Journal& journal) {
    return CampaignTasks(Campaign::from_document(nlohmann::ordered_json::parse(journal.head().document)));
}

WaitingRun run_waiting(const CampaignTasks& tasks, Journal& journal, const CampaignOptions& options,
                       const DealerCalls& calls) {
    LiveReport report(journal, options.out);
    DealerCalls reporting = calls;
    reporting.progress = [&](const CampaignProgress& progress) {
        if (calls.progress) calls.progress(progress);
        report.renew();
    };
    reporting.before_fork = [&] { report.wait(); };
    const bool ended = run_campaign(tasks, journal, options, run_task, reporting);
    report.finish();
    const int code = !ended ? ended_by_signal : journal.counts().done > 0 ? success : no_valid_answer;
    return {code, campaign_status(journal)};
}

int refusals_told(const std::function<void(const std::string&)>& tell, const std::function<int()>& work) {
    try {
        return work();
    } catch (const OtherCampaign& error) {
        tell(error.what());
        return wrong_call;
    } catch (const NoMpi& error) {
        tell(error.what());
        return wrong_call;
    } catch (const JournalError& error) {
        tell(error.what());
        return not_stored;
    }
}

}  // namespace orbid::apps
