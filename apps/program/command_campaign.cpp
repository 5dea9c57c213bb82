#include "apps/program/command_campaign.hpp"

#include <charconv>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>

#include <fmt/format.h>

#include "apps/campaign/engine/campaign_run.hpp"
#include "apps/campaign/engine/worker.hpp"
#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/documents/atomic_file.hpp"
#include "apps/program/campaign_progress.hpp"
#include "apps/program/colour.hpp"
#include "apps/program/job_run.hpp"
#include "apps/ranks/rank_plugin.hpp"
#include "apps/stages/interruption.hpp"

namespace orbid::apps {

namespace {

/// Runs the job of a task in one thread, without files.
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

CampaignOptions campaign_options(const CommandCall& call, const std::filesystem::path& out) {
    CampaignOptions options;
    options.out = out;
    options.ranks = call.whole_number("threads", 0, 0);
    const std::string engine = call.value("engine", engine_names.front());
    for (std::size_t i = 0; i < engine_names.size(); ++i)
        if (engine == engine_names[i]) options.engine = static_cast<Engine>(i);
    return options;
}

/// Runs what waits in a journal, and tells how it went.
int run_waiting(const CommandCall& call, const CampaignTasks& tasks, Journal& journal, const CampaignOptions& options) {
    CampaignProgressLine line(call.console, call.has("quiet"),
                              std::chrono::seconds(call.whole_number("progress", 10, 1)));
    std::optional<InterruptionGuard> signals;
    if (call.console.signals) signals.emplace();
    DealerCalls calls;
    calls.stopped = [&] { return (signals && signals->asked()) || (call.console.stopped && call.console.stopped()); };
    calls.progress = [&](const CampaignProgress& progress) { line.show(progress); };
    const bool ended = run_campaign(tasks, journal, options, run_task, calls);
    return ended ? success : ended_by_signal;
}

int finish(const CommandCall& call, const Journal& journal, int code) {
    const JournalCounts counts = journal.counts();
    call.console.out << fmt::format("{} done, {} failed, {} waiting\n", counts.done, counts.failed, counts.waiting);
    if (code == success && counts.done == 0) return no_valid_answer;
    return code;
}

/// A campaign's file, its folder left out of the command.
std::filesystem::path folder_of(const CommandCall& call) {
    std::filesystem::path out = call.words[0];
    if (out.extension() == ".json")
        out.replace_extension();
    else
        out += ".out";
    return call.value("out", out.string());
}

int run_file(const CommandCall& call, estimator::Ranks* given) {
    const std::filesystem::path file = call.words[0];
    const bool coloured = is_coloured(call.value("color", "auto"), call.console.error_terminal);
    const auto refuse = [&](const std::string& text, int code) {
        call.console.error << error_text(text, coloured) << '\n';
        return code;
    };
    if (!std::filesystem::exists(file)) return refuse(file.string() + ": the campaign file does not exist", wrong_call);
    if (!std::filesystem::is_regular_file(file)) return refuse(file.string() + ": is no file", wrong_call);
    const CampaignReading reading = read_campaign(read_whole_file(file), file);
    for (const Problem& problem : reading.problems)
        call.console.error << error_text(message(problem, file.string()), coloured) << '\n';
    if (!reading.campaign) return reading.exit_code();
    const CampaignTasks tasks(*reading.campaign);
    CampaignOptions options = campaign_options(call, folder_of(call));
    options.given = given;
    try {
        Journal journal = campaign_journal(tasks, options.out);
        return finish(call, journal, run_waiting(call, tasks, journal, options));
    } catch (const OtherCampaign& error) {
        return refuse(error.what(), wrong_call);
    } catch (const JournalError& error) {
        return refuse(error.what(), not_stored);
    }
}

/// Rank 0 does what the command says; the others serve it.
int run_on_ranks(const CommandCall& call) {
    if (!under_mpi()) return run_file(call, nullptr);
    const std::unique_ptr<estimator::Ranks> ranks = mpi_ranks();
    if (ranks->rank() > 0) return serve_tasks(*ranks, run_task);
    return run_file(call, ranks.get());
}

}  // namespace

std::vector<std::string> engine_choices() {
    return engine_names;
}

int run_campaign_command(const CommandCall& call) {
    return run_on_ranks(call);
}

}  // namespace orbid::apps
