#include "apps/campaign/engine/campaign_run.hpp"

#include <map>
#include <mutex>
#include <set>
#include <thread>

#include "apps/campaign/engine/task_message.hpp"
#include "apps/campaign/engine/task_queue.hpp"
#include "apps/campaign/engine/worker.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"
#include "estimator/ranks/thread_ranks.hpp"
#include "tests/apps/campaign/echo_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::campaign_run_test {
namespace {

using apps::Campaign;
using apps::CampaignTasks;
using apps::Engine;
using apps::Journal;
using apps::TaskRun;
using apps::TaskState;
using tests::echo;
using tests::made_campaign;
using tests::numbers;
using tests::rows;
using tests::run;
using tests::TemporaryFolder;

TEST_CASE("A campaign that was stopped goes on, and repeats no task that has ended", "[campaign]") {
    const CampaignTasks tasks(made_campaign({1, 2}, 50));
    const TemporaryFolder folder;
    std::mutex mutex;
    std::map<std::string, int> times;
    const auto runner = [&](const std::string& text, const auto&, const auto&) {
        const std::lock_guard lock(mutex);
        ++times[numbers(text).dump()];
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return echo(text);
    };
    std::int64_t before = 0;
    {
        Journal journal = apps::campaign_journal(tasks, folder.path());
        apps::DealerCalls calls;
        calls.stopped = [&] { return journal.counts().done >= 20; };
        CHECK_FALSE(run(tasks, journal, Engine::threads, runner, calls));
        before = journal.counts().done;
        CHECK(before >= 20);
        CHECK(before < 100);
    }
    Journal journal = apps::campaign_journal(tasks, folder.path());
    CHECK(journal.counts().done == before);
    CHECK(run(tasks, journal, Engine::threads, runner));
    CHECK(journal.counts().done == 100);
    for (const auto& [number, row] : rows(journal))
        CHECK(row.attempts == 1);
}

TEST_CASE("A task ends at its limit, whether it asks or not", "[campaign]") {
    Campaign campaign = made_campaign({1}, 3);
    campaign.seconds = 0.05;
    const CampaignTasks tasks(campaign);
    const TemporaryFolder folder;
    Journal journal = apps::campaign_journal(tasks, folder.path());
    const auto runner = [](const std::string& text, const auto&, const std::function<bool()>& stopped) {
        TaskRun run = echo(text);
        if (numbers(text)["seed"] != 2) return run;
        while (!stopped())
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        run.exit_code = 130;
        return run;
    };
    CHECK(run(tasks, journal, Engine::threads, runner));
    auto all = rows(journal);
    CHECK(all[0].outcome.state == TaskState::done);
    CHECK(all[1].outcome.state == TaskState::failed);
    CHECK(all[1].outcome.status == "time_limit");
    CHECK(all[1].outcome.parameters.size() == 1);  // the best so far
}

TEST_CASE("A journal of another campaign is refused, with the first difference", "[campaign]") {
    const TemporaryFolder folder;
    { const Journal made = apps::campaign_journal(CampaignTasks(made_campaign({1}, 3)), folder.path()); }
    try {
        (void)apps::campaign_journal(CampaignTasks(made_campaign({1}, 4)), folder.path());
        FAIL("was accepted");
    } catch (const apps::OtherCampaign& error) {
        CHECK(std::string(error.what()).find("/replicates is 3 there, 4 in this one") != std::string::npos);
    }
}

TEST_CASE("Of groups of tasks the longest comes first, unknown ones before all", "[campaign]") {
    const CampaignTasks tasks(made_campaign({1, 2, 3}, 4));
    std::vector<std::int64_t> waiting;
    for (std::int64_t number = 0; number < tasks.count(); ++number)
        waiting.push_back(number);
    apps::TaskQueue queue(tasks, waiting);
    CHECK(queue.expected_total() == 0.0);
    std::set<std::int64_t> first{*queue.next(), *queue.next(), *queue.next()};
    CHECK(first == std::set<std::int64_t>{0, 4, 8});
    queue.ended(0, 1.0);
    queue.ended(4, 3.0);
    queue.ended(8, 2.0);
    CHECK(queue.expected(5) == 3.0);
    CHECK_THAT(queue.expected_total(), tests::WithinRel(18.0, 1e-12));
    std::vector<std::int64_t> order;
    while (const auto number = queue.next())
        order.push_back(*number);
    CHECK(order == std::vector<std::int64_t>{5, 6, 7, 9, 10, 11, 1, 2, 3});
    queue.put_back(6);
    CHECK(queue.count() == 1);
    CHECK(queue.next() == 6);
    CHECK(queue.empty());
}

TEST_CASE("Messages between ranks come back as they were, and cut ones are refused", "[campaign]") {
    apps::TaskMessage message;
    message.kind = apps::TaskMessage::Kind::outcome;
    message.number = 12;
    message.text = "a\0b";
    message.outcome.number = 12;
    message.outcome.status = "converged";
    message.outcome.result = std::string(1000, '\xff');
    message.outcome.parameters.push_back({"k", 1.0, 0.1, 0.8, 1.2, 1.05, 0.09});
    const std::vector<std::byte> bytes = apps::packed(message);
    const apps::TaskMessage back = apps::unpacked(bytes);
    CHECK(back.number == 12);
    CHECK(back.outcome.result == message.outcome.result);
    REQUIRE(back.outcome.parameters.size() == 1);
    CHECK(back.outcome.parameters[0].bound == 0.09);
    for (std::size_t size = 0; size < bytes.size(); size += 7)
        CHECK_THROWS_AS(apps::unpacked(std::span(bytes).first(size)), std::runtime_error);
}

TEST_CASE("A rank that cannot take the campaign up says why", "[campaign]") {
    estimator::ThreadRanks ranks(2);
    apps::TaskMessage first;
    first.kind = apps::TaskMessage::Kind::campaign;
    first.text = R"({ "format": "orbid-campaign/9" })";
    ranks[0].send(1, apps::packed(first));
    CHECK(apps::serve_tasks(ranks[1], {}) == 1);
    const apps::TaskMessage answer = apps::unpacked(ranks[0].receive(1).content);
    CHECK(answer.kind == apps::TaskMessage::Kind::refusal);
    CHECK(answer.text.find("orbid-campaign/9") != std::string::npos);
}

}  // namespace
}  // namespace orbid::campaign_run_test
