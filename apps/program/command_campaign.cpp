#include "apps/program/command_campaign.hpp"

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <ostream>
#include <stdexcept>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "apps/campaign/engine/campaign_run.hpp"
#include "apps/campaign/engine/worker.hpp"
#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/campaign/report/campaign_report.hpp"
#include "apps/campaign/tables/campaign_status.hpp"
#include "apps/campaign/tables/campaign_table.hpp"
#include "apps/documents/atomic_file.hpp"
#include "apps/documents/compression.hpp"
#include "apps/documents/printable.hpp"
#include "apps/program/campaign_progress.hpp"
#include "apps/program/campaign_work.hpp"
#include "apps/program/colour.hpp"
#include "apps/ranks/rank_plugin.hpp"
#include "apps/stages/interruption.hpp"

namespace orbid::apps {

namespace {

CampaignOptions campaign_options(const CommandCall& call, const std::filesystem::path& out, estimator::Ranks* given) {
    CampaignOptions options;
    options.out = out;
    options.ranks = call.whole_number("threads", 0, 0);
    const std::string engine = call.value("engine", engine_names.front());
    for (std::size_t i = 0; i < engine_names.size(); ++i)
        if (engine == engine_names[i]) options.engine = static_cast<Engine>(i);
    // Processes are forked while there is one thread, which a caller of the library does not promise.
    if (options.engine == Engine::automatic && !call.console.own_process) options.engine = Engine::threads;
    options.given = given;
    return options;
}

/// Runs what waits in a journal, and tells how it went.
int run_and_show(const CommandCall& call, const CampaignTasks& tasks, Journal& journal,
                 const CampaignOptions& options) {
    CampaignProgressLine line(call.console, call.has("quiet"),
                              std::chrono::seconds(call.whole_number("progress", 10, 1)));
    std::optional<InterruptionGuard> signals;
    if (call.console.signals) signals.emplace();
    DealerCalls calls;
    calls.stopped = [&] { return (signals && signals->asked()) || (call.console.stopped && call.console.stopped()); };
    calls.progress = [&](const CampaignProgress& progress) { line.show(progress); };
    const WaitingRun run = run_waiting(tasks, journal, options, calls);
    call.console.out << run.status;
    return run.exit_code;
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

/// Calls what may refuse a journal or a campaign; exit code.
template <class Work>
int refusing(const CommandCall& call, const Work& work) {
    const bool coloured = is_coloured(call.value("color", "auto"), call.console.error_terminal);
    const auto refuse = [&](const std::string& text, int code) {
        write_unfiltered(call.console.error, error_text(text, coloured) + '\n');
        return code;
    };
    return refusals_told([&](const std::string& text) { refuse(text, wrong_call); }, [&] { return work(refuse); });
}

int run_file(const CommandCall& call, estimator::Ranks* given) {
    return refusing(call, [&](const auto& refuse) {
        const std::filesystem::path file = call.words[0];
        if (!std::filesystem::exists(file))
            return refuse(file.string() + ": the campaign file does not exist", wrong_call);
        if (!std::filesystem::is_regular_file(file)) return refuse(file.string() + ": is no file", wrong_call);
        const CampaignReading reading = read_campaign(read_whole_file(file, largest_job_file), file);
        int code = success;
        for (const Problem& problem : reading.problems)
            code = refuse(message(problem, file.string()), reading.exit_code());
        if (!reading.campaign) return code;
        const CampaignTasks tasks(*reading.campaign);
        const CampaignOptions options = campaign_options(call, folder_of(call), given);
        Journal journal = whole_journal(tasks, options.out, call.console.error);
        return run_and_show(call, tasks, journal, options);
    });
}

// What is asked of a journal in a folder.

int show_status(const CommandCall& call, const std::filesystem::path& folder, estimator::Ranks*) {
    const Journal journal = Journal::open(folder / journal_name, Journal::Access::read);
    call.console.out << campaign_status(journal);
    return success;
}

/// Failed tasks wait again, and are run.
int retry_failed(const CommandCall& call, const std::filesystem::path& folder, estimator::Ranks* given) {
    Journal journal = whole_journal(folder, call.console.error);
    const CampaignTasks tasks = tasks_of(journal);
    const std::int64_t again = journal.retry(call.value("status", ""));
    call.console.error << fmt::format("{} failed tasks are tried again\n", again);
    return run_and_show(call, tasks, journal, campaign_options(call, folder, given));
}

int write_tables(const CommandCall& call, const std::filesystem::path& folder, estimator::Ranks*) {
    const Journal journal = Journal::open(folder / journal_name, Journal::Access::read);
    if (call.has("job")) {
        const CampaignTasks tasks = tasks_of(journal);
        const std::int64_t number = call.whole_number("job", 0, 0);
        if (number >= tasks.count())
            throw CommandLineError(fmt::format("--job must be below {}, the number of tasks", tasks.count()));
        call.console.out << tasks.job_text(number);
        call.console.error << fmt::format("paths in it start at {}\n",
                                          tasks.base(number).source.parent_path().string());
        return success;
    }
    if (call.has("result")) {
        const std::string result = journal.result(call.whole_number("result", 0, 0));
        if (!result.empty()) call.console.out << uncompressed(result);
        return result.empty() ? no_valid_answer : success;
    }
    TableOptions options;
    options.times = call.has("times");
    const std::string table = call.value("table", campaign_table_names.front());
    for (std::size_t i = 0; i < campaign_table_names.size(); ++i)
        if (table == campaign_table_names[i]) options.table = static_cast<CampaignTable>(i);
    if (call.value("out", "-") == "-") {
        write_campaign_table(journal, call.console.out, options);
        return success;
    }
    const std::string out = call.value("out", "");
    write_atomically(out, [&](const std::filesystem::path& temporary) {
        std::ofstream file(temporary, std::ios::binary);
        bool written = static_cast<bool>(file);
        try {
            if (written) write_campaign_table(journal, file, options);
            written = written && file.flush();
        } catch (const std::runtime_error&) {
            if (file) throw;  // the journal's
            written = false;
        }
        if (!written)
            throw FileNotWritten(fmt::format("cannot write {}: {}", out, std::generic_category().message(errno)));
    });
    return success;
}

int write_report_anew(const CommandCall&, const std::filesystem::path& folder, estimator::Ranks*) {
    write_campaign_report(Journal::open(folder / journal_name, Journal::Access::read), folder / "report.html");
    return success;
}

struct Verb {
    std::string name;
    /// @param given  rank 0 of the ranks that MPI has started; null: there are none
    int (*run)(const CommandCall& call, const std::filesystem::path& folder, estimator::Ranks* given);
};

const std::vector<Verb>& verbs() {
    static const std::vector<Verb> all{
        {"status", show_status}, {"retry", retry_failed}, {"export", write_tables}, {"report", write_report_anew}};
    return all;
}

int run_verb_or_file(const CommandCall& call, estimator::Ranks* given) {
    for (const Verb& verb : verbs()) {
        if (call.words[0] != verb.name) continue;
        if (call.words.size() < 2)
            throw CommandLineError(fmt::format("orbid campaign {} needs the folder of a campaign", verb.name));
        const std::filesystem::path folder = call.words[1];
        if (!std::filesystem::is_regular_file(folder / journal_name))
            throw CommandLineError(fmt::format("{} holds no {}", folder.string(), journal_name));
        return refusing(call, [&](const auto&) { return verb.run(call, folder, given); });
    }
    if (call.words.size() > 1)
        throw CommandLineError(fmt::format("\"{}\" is none of status, retry, export, report", call.words[0]));
    return run_file(call, given);
}

}  // namespace

std::vector<std::string> engine_choices() {
    return engine_names;
}

std::vector<std::string> campaign_table_choices() {
    return campaign_table_names;
}

std::vector<std::string> campaign_verbs() {
    std::vector<std::string> names;
    for (const Verb& verb : verbs())
        names.push_back(verb.name);
    return names;
}

int run_campaign_command(const CommandCall& call) {
    if (!under_mpi()) return run_verb_or_file(call, nullptr);
    return refusing(call, [&](const auto&) {
        // Rank 0 does what the command says, the others serve it.
        const std::unique_ptr<estimator::Ranks> ranks = mpi_ranks();
        return ranks->rank() > 0 ? serve_tasks(*ranks, run_task) : run_verb_or_file(call, ranks.get());
    });
}

}  // namespace orbid::apps
