#include <csignal>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>

#include "apps/program/campaign_run_text.hpp"
#include "tests/apps/campaign/echo_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::campaign_processes_test {
namespace {

using apps::CampaignTasks;
using apps::Engine;
using apps::Journal;
using apps::TaskState;
using tests::echo;
using tests::made_campaign;
using tests::numbers;
using tests::rows;
using tests::run;
using tests::TemporaryFolder;

TEST_CASE("Threads and processes store the same outcomes of every task", "[campaign]") {
    const CampaignTasks tasks(made_campaign({1, 2, 3}, 40));
    std::map<Engine, std::map<std::int64_t, Journal::Row>> stored;
    for (const Engine engine : {Engine::threads, Engine::processes}) {
        const TemporaryFolder folder;
        Journal journal = apps::campaign_journal(tasks, folder.path() / "out");
        CHECK(
            run(tasks, journal, engine, [](const std::string& text, const auto&, const auto&) { return echo(text); }));
        CHECK(journal.counts().done == 120);
        CHECK(journal.counts().waiting == 0);
        stored[engine] = rows(journal);
    }
    REQUIRE(stored[Engine::threads].size() == 120);
    for (const auto& [number, row] : stored[Engine::threads]) {
        const auto& other = stored[Engine::processes].at(number);
        CHECK(row.plan.key == other.plan.key);
        REQUIRE(row.outcome.parameters.size() == 1);
        REQUIRE(other.outcome.parameters.size() == 1);
        CHECK(row.outcome.parameters[0].value == other.outcome.parameters[0].value);
        CHECK(row.outcome.parameters[0].value ==
              Approx(static_cast<double>(1 + number / 40) + 1e-3 * static_cast<double>(1 + number % 40)));
    }
}

TEST_CASE("A task whose process crashes has failed, and the others are run", "[campaign]") {
    const CampaignTasks tasks(made_campaign({1}, 30));
    const TemporaryFolder folder;
    Journal journal = apps::campaign_journal(tasks, folder.path());
    const auto runner = [](const std::string& text, const auto&, const auto&) {
        if (numbers(text)["seed"] == 7) ::raise(SIGKILL);
        if (numbers(text)["seed"] == 9) throw std::runtime_error("nine");
        return echo(text);
    };
    CHECK(run(tasks, journal, Engine::processes, runner));
    auto all = rows(journal);
    CHECK(journal.counts().done == 28);
    CHECK(all[6].outcome.state == TaskState::failed);
    CHECK(all[6].outcome.status == "crash");
    CHECK(all[6].outcome.message.find("SIGKILL") != std::string::npos);
    CHECK(all[8].outcome.status == "error");
    CHECK(all[8].outcome.message == "nine");

    // Tried again when asked, and only then.
    const auto well = [](const std::string& text, const auto&, const auto&) { return echo(text); };
    CHECK(run(tasks, journal, Engine::processes, well));
    CHECK(journal.counts().failed == 2);
    CHECK(journal.retry("crash") == 1);
    CHECK(run(tasks, journal, Engine::threads, well));
    CHECK(journal.counts().done == 29);
    CHECK(rows(journal)[6].attempts == 2);
}

TEST_CASE("A campaign given as text stores the same in processes and in threads", "[campaign]") {
    const std::string text = R"({
      "kind": "sweep", "replicates": 4,
      "job": {
        "model": { "name": "free_pendulum", "parameters": { "w0sq": 30 } },
        "data": { "simulate": { "samples": { "step": 0.02, "count": 31 }, "noise": { "phi": 0.01, "phi_dot": 0.01 },
                                "initial": [[1.0, 0.0]] } },
        "estimate": { "parameters": { "w0sq": { "start": 33 } }, "residuals": [ { "type": "series" } ] } } })";
    const TemporaryFolder folder;
    std::map<bool, std::map<std::int64_t, Journal::Row>> stored;
    // Processes first: they are forked while there is one thread.
    for (const bool processes : {true, false}) {
        apps::CampaignRunOptions options;
        options.out = folder.path() / (processes ? "processes" : "threads");
        options.threads = 2;
        options.processes = processes;
        const apps::CampaignRun ran = apps::run_campaign_text(text, folder.path() / "campaign.json", options);
        CHECK(ran.exit_code == 0);
        CHECK(ran.counts.done == 4);
        stored[processes] = rows(Journal::open(options.out / apps::journal_name, Journal::Access::read));
    }
    REQUIRE(stored[true].size() == 4);
    for (const auto& [number, row] : stored[true]) {
        REQUIRE(row.outcome.parameters.size() == 3);
        for (std::size_t k = 0; k < 3; ++k) {
            CHECK(row.outcome.parameters[k].value == stored[false][number].outcome.parameters[k].value);
            CHECK(row.outcome.parameters[k].sd == stored[false][number].outcome.parameters[k].sd);
        }
    }
}

}  // namespace
}  // namespace orbid::campaign_processes_test
