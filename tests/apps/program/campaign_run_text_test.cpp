#include "apps/program/campaign_run_text.hpp"

#include <cmath>
#include <map>

#include "apps/campaign/engine/campaign_run.hpp"
#include "apps/program/command_schema.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::campaign_run_text_test {
namespace {

using apps::CampaignRun;
using apps::Journal;
using tests::json;
using tests::Path;
using tests::TemporaryFolder;

json made_campaign(int replicates) {
    json campaign = json::parse(R"({
      "kind": "sweep", "seed": 3,
      "job": {
        "model": { "name": "free_pendulum", "parameters": { "w0sq": 30, "c2": 0.05 } },
        "data": { "simulate": { "samples": { "step": 0.02, "count": 51 }, "noise": { "phi": 0.005, "phi_dot": 0.02 },
                                "initial": [[1.0, 0.0]] } },
        "estimate": { "parameters": { "w0sq": { "start": 33 } }, "residuals": [ { "type": "series" } ] }
      },
      "vary": [ { "key": "/data/simulate/samples/count", "values": [31, 51] } ] })");
    campaign["replicates"] = replicates;
    return campaign;
}

/// Runs a campaign in two threads and fails when anything reached the streams of the process.
CampaignRun silent_run(const json& campaign, const Path& out, const apps::CampaignRunCalls& calls = {},
                       bool retry = false) {
    const TemporaryFolder folder;
    apps::CampaignRunOptions options;
    options.out = out;
    options.threads = 2;
    options.retry = retry;
    tests::CaughtStream output(STDOUT_FILENO, folder.path() / "out");
    tests::CaughtStream error(STDERR_FILENO, folder.path() / "error");
    CampaignRun run =
        apps::run_campaign_text(campaign.dump(), out.parent_path() / "never_written.json", options, calls);
    REQUIRE(output.finish().empty());
    REQUIRE(error.finish().empty());
    return run;
}

/// What each task gave: its result.json, and its estimates with their truth.
std::map<std::int64_t, std::vector<double>> values(const Path& folder) {
    const Journal journal = Journal::open(folder / apps::journal_name, Journal::Access::read);
    std::map<std::int64_t, std::vector<double>> all;
    journal.each_row([&](const Journal::Row& row) {
        for (const auto& parameter : row.outcome.parameters)
            all[row.plan.number].insert(all[row.plan.number].end(), {parameter.value, parameter.sd, parameter.lower});
    });
    return all;
}

TEST_CASE("a campaign given as text gives what the program gives, without printing", "[apps][campaign]") {
    const TemporaryFolder folder;
    const json campaign = made_campaign(3);
    std::vector<apps::CampaignRunProgress> told;
    apps::CampaignRunCalls calls;
    calls.progress = [&](const apps::CampaignRunProgress& progress) { told.push_back(progress); };
    const CampaignRun run = silent_run(campaign, folder.path() / "library", calls);
    CHECK(run.exit_code == 0);
    CHECK(run.problems.empty());
    CHECK(run.messages.empty());
    CHECK(run.counts.tasks == 6);
    CHECK(run.counts.done == 6);
    CHECK(run.counts.waiting == 0);
    REQUIRE_FALSE(told.empty());
    for (const auto& progress : told) {
        CHECK(progress.counts.tasks == 6);
        CHECK(progress.counts.done + progress.counts.failed + progress.counts.waiting == 6);
    }

    const Path file = tests::write_job(folder.path() / "campaign.json", campaign);
    const Path program = folder.path() / "program";
    const tests::Outcome outcome =
        tests::orbid_with({"campaign", file.string(), "--out", program.string(), "--engine", "threads", "--quiet"});
    REQUIRE(outcome.code == 0);
    const auto from_library = values(folder.path() / "library");
    REQUIRE(from_library.size() == 6);
    CHECK(from_library == values(program));
    CHECK(from_library.at(0).size() == 9);  // w0sq and two error scales
    CHECK_THAT(from_library.at(0)[0], tests::WithinRel(30.0, 0.01));

    // The job of a task, alone, gives its estimate.
    const apps::CampaignTaskJob job = apps::campaign_task_job(folder.path() / "library", 4);
    apps::RunOptions in_memory;
    in_memory.in_memory = true;
    const json alone = json::parse(apps::run_job_text(job.text, job.source, in_memory).result);
    CHECK(alone["parameters"]["w0sq"]["value"] == from_library.at(4)[0]);
    CHECK_THROWS_WITH(apps::campaign_task_job(folder.path() / "library", 6), "task 6: the campaign has tasks 0 to 5");
    CHECK_THROWS_AS(apps::campaign_task_job(folder.path(), 0), std::runtime_error);
}

TEST_CASE("a caller stops a campaign, and the same call goes on", "[apps][campaign]") {
    const TemporaryFolder folder;
    const json campaign = made_campaign(50);
    apps::CampaignRunCalls calls;
    // Asked after every answer, or after some at once: however fast tasks are, only a few have ended by then.
    int asked = 0;
    calls.stopped = [&] { return ++asked > 3; };
    const CampaignRun stopped = silent_run(campaign, folder.path() / "out", calls);
    CHECK(stopped.exit_code == 130);
    CHECK(stopped.counts.waiting > 0);
    CHECK(stopped.counts.waiting + stopped.counts.done == 100);
    const auto before = values(folder.path() / "out");
    const CampaignRun whole = silent_run(campaign, folder.path() / "out");
    CHECK(whole.exit_code == 0);
    CHECK(whole.counts.done == 100);
    const auto after = values(folder.path() / "out");
    for (const auto& [number, numbers] : before)
        CHECK(after.at(number) == numbers);
    // As if nobody had stopped it.
    CHECK(silent_run(campaign, folder.path() / "other").exit_code == 0);
    CHECK(after == values(folder.path() / "other"));

    // Another campaign into the same folder.
    const CampaignRun refused = silent_run(made_campaign(51), folder.path() / "out");
    CHECK(refused.exit_code == 2);
    CHECK(refused.problems.empty());
    CHECK_THAT(refused.messages, tests::ContainsSubstring("journal of another campaign (/replicates"));
}

TEST_CASE("failed tasks are run again when asked", "[apps][campaign]") {
    const TemporaryFolder folder;
    json campaign = made_campaign(1);
    campaign["vary"][0] = {{"key", "/data/simulate/initial/0/0"}, {"values", {1.0, 1e300}}};
    const CampaignRun run = silent_run(campaign, folder.path() / "out");
    const auto attempts = [&] {
        const Journal journal = Journal::open(folder.path() / "out" / apps::journal_name, Journal::Access::read);
        std::vector<int> all;
        journal.each_row([&](const Journal::Row& row) { all.push_back(row.attempts); });
        return all;
    };
    REQUIRE(run.counts.failed == 1);
    CHECK(run.exit_code == 0);
    CHECK(silent_run(campaign, folder.path() / "out").counts.failed == 1);
    CHECK(attempts() == std::vector<int>{1, 1});
    CHECK(silent_run(campaign, folder.path() / "out", {}, true).counts.failed == 1);
    CHECK(attempts() == std::vector<int>{1, 2});
}

TEST_CASE("problems of a campaign given as text have pointer and rule", "[apps][campaign]") {
    const TemporaryFolder folder;
    json campaign = made_campaign(3);
    campaign["replikates"] = 3;
    const CampaignRun run = silent_run(campaign, folder.path() / "out");
    CHECK(run.exit_code == 2);
    REQUIRE(run.problems.size() == 1);
    CHECK(run.problems[0].pointer == "/replikates");
    CHECK_THAT(run.problems[0].rule, tests::ContainsSubstring("did you mean \"replicates\"?"));
    CHECK_THAT(run.problems[0].text, tests::ContainsSubstring("never_written.json:1:"));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "out"));
    CHECK_THROWS_AS(apps::run_campaign_text("{}", folder.path() / "a.json", {}), std::invalid_argument);
}

TEST_CASE("schema and reference of campaigns in docs are current", "[apps][campaign]") {
    const Path docs = tests::source_folder() + "/docs";
    // Written anew by: orbid schema --campaign > docs/orbid-campaign.schema.json;
    // orbid schema --campaign --markdown > docs/campaign_reference.md
    CHECK((apps::read_whole_file(docs / "orbid-campaign.schema.json") == apps::campaign_schema_text()));
    CHECK((apps::read_whole_file(docs / "campaign_reference.md") == apps::campaign_reference_text()));
    CHECK(tests::orbid_with({"schema", "--campaign"}).out == apps::campaign_schema_text());
    CHECK(tests::orbid_with({"schema", "--campaign", "--markdown"}).out == apps::campaign_reference_text());
}

}  // namespace
}  // namespace orbid::campaign_run_text_test
