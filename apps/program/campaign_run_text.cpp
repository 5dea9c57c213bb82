#include "apps/program/campaign_run_text.hpp"

#include <sstream>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/program/campaign_work.hpp"
#include "apps/program/problem_list.hpp"

namespace orbid::apps {

namespace {

CampaignTaskCounts counts_of(const CampaignProgress& progress) {
    return {progress.tasks, progress.tasks - progress.done - progress.failed, progress.done, progress.failed};
}

CampaignTaskCounts counts_of(const Journal& journal) {
    const JournalCounts counts = journal.counts();
    return {journal.head().tasks, counts.waiting, counts.done, counts.failed};
}

DealerCalls dealer_calls(const CampaignRunCalls& calls) {
    DealerCalls dealer;
    dealer.stopped = [&calls] { return calls.stopped && calls.stopped(); };
    dealer.progress = [&calls](const CampaignProgress& progress) {
        if (calls.progress)
            calls.progress({counts_of(progress), progress.in_work, progress.seconds, progress.remaining});
    };
    return dealer;
}

}  // namespace

CampaignRun run_campaign_text(std::string_view text, const std::filesystem::path& source,
                              const CampaignRunOptions& options, const CampaignRunCalls& calls) {
    if (options.out.empty()) throw std::invalid_argument("run_campaign_text: options.out is empty, needs a folder");
    if (options.threads < 0)
        throw std::invalid_argument(
            fmt::format("run_campaign_text: options.threads must be >= 0, not {}", options.threads));
    CampaignRun run;
    const CampaignReading reading = read_campaign(text, source);
    run.problems = problem_list(reading.problems, source);
    run.exit_code = reading.exit_code();
    if (!reading.campaign) return run;
    const CampaignTasks tasks(*reading.campaign);
    CampaignOptions engine;
    engine.out = options.out;
    engine.ranks = options.threads;
    engine.engine = options.processes ? Engine::processes : Engine::threads;
    std::ostringstream messages;
    run.exit_code = refusals_told([&](const std::string& refusal) { messages << refusal << '\n'; },
                                  [&] {
                                      Journal journal = whole_journal(tasks, options.out, messages);
                                      if (options.retry) (void)journal.retry();
                                      const WaitingRun waiting =
                                          run_waiting(tasks, journal, engine, dealer_calls(calls));
                                      run.summary = waiting.status;
                                      run.counts = counts_of(journal);
                                      return waiting.exit_code;
                                  });
    run.messages = messages.str();
    return run;
}

CampaignTaskJob campaign_task_job(const std::filesystem::path& folder, std::int64_t number) {
    const CampaignTasks tasks = tasks_of(Journal::open(folder / journal_name, Journal::Access::read));
    if (number < 0 || number >= tasks.count())
        throw std::invalid_argument(fmt::format("task {}: the campaign has tasks 0 to {}", number, tasks.count() - 1));
    return {tasks.job_text(number), tasks.base(number).source};
}

}  // namespace orbid::apps
