#include "apps/campaign/plan/campaign_file.hpp"

#include <filesystem>
#include <string>

#include "apps/campaign/plan/campaign_tasks.hpp"
#include "apps/documents/atomic_file.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::campaign_test {
namespace {

using nlohmann::ordered_json;
using tests::TemporaryFolder;

constexpr const char* henon_job = R"({
  "model": { "name": "henon", "parameters": { "a": 1.4, "b": 0.3 } },
  "data": { "simulate": { "sections": 200, "initial": [[0.1, 0.1]], "noise": { "x": 0.01, "y": 0.003 } } },
  "estimate": { "parameters": { "a": { "start": 1.3 }, "b": { "start": 0.25 } }, "residuals": [ { "type": "series" } ] }
})";

/// Reads a campaign whose job is henon.json beside it.
apps::CampaignReading read(const std::string& text) {
    const TemporaryFolder folder;
    tests::write_text(folder.path() / "henon.json", henon_job);
    return apps::read_campaign(text, folder.path() / "campaign.json");
}

std::string problem(const std::string& text) {
    const apps::CampaignReading reading = read(text);
    REQUIRE_FALSE(reading.problems.empty());
    return apps::message(reading.problems.front(), "campaign.json");
}

TEST_CASE("Every task of a campaign follows from its number", "[campaign]") {
    const apps::CampaignReading reading = read(R"({
      "kind": "sweep", "job": "henon.json", "seed": 7, "replicates": 3,
      "vary": [
        { "key": "/data/simulate/sections", "values": [100, 200] },
        { "keys": ["/model/parameters/a", "/estimate/parameters/a/start"], "values": [[1.4, 1.3], [1.2, 1.1]] },
        { "key": "/estimate/parameters/b/start", "draw": { "uniform": [0.2, 0.4] } }
      ]
    })");
    REQUIRE(reading.campaign);
    const apps::CampaignTasks tasks(*reading.campaign);
    REQUIRE(tasks.count() == 12);
    std::vector<std::string> names;
    for (const auto& column : tasks.columns())
        names.push_back(column.name);
    CHECK(names == std::vector<std::string>{"sections", "a", "a_start", "b_start", "seed"});

    const apps::TaskPlan plan = tasks.plan(7);  // settings 1 and 0, replicate 1
    CHECK(plan.values[0] == "200");
    CHECK(plan.values[1] == "1.4");
    CHECK(plan.values[4] == "8");
    CHECK(plan.seed == 8);
    const auto job = ordered_json::parse(tasks.job_text(7));
    CHECK(job["data"]["simulate"]["sections"] == 200);
    CHECK(job["model"]["parameters"]["a"] == 1.4);
    CHECK(job["estimate"]["parameters"]["a"]["start"] == 1.3);
    CHECK(job["seed"] == 8);
    const double drawn = job["estimate"]["parameters"]["b"]["start"];
    CHECK(ordered_json(drawn).dump() == plan.values[3]);
    CHECK((drawn > 0.2 && drawn < 0.4));
    // The same replicate of another setting draws the same: what differs is the setting alone.
    CHECK(tasks.plan(1).values[3] == plan.values[3]);
    CHECK(tasks.plan(2).values[3] != plan.values[3]);
    CHECK(tasks.plan(1).key != plan.key);

    // As rank 0 sends it to the others.
    const apps::CampaignTasks sent(
        apps::Campaign::from_document(ordered_json::parse(reading.campaign->document().dump())));
    for (std::int64_t number = 0; number < tasks.count(); ++number) {
        CHECK(sent.job_text(number) == tasks.job_text(number));
        CHECK(sent.plan(number).key == tasks.plan(number).key);
    }
}

TEST_CASE("Numbers of a job are multiplied by what varies", "[campaign]") {
    const apps::CampaignReading reading = read(R"({
      "kind": "sweep", "job": "henon.json", "vary": [ { "key": "/data/simulate/noise", "multiply_by": [1, 5] } ] })");
    REQUIRE(reading.campaign);
    const apps::CampaignTasks tasks(
        apps::Campaign::from_document(ordered_json::parse(reading.campaign->document().dump())));
    REQUIRE(tasks.count() == 2);
    CHECK(tasks.columns()[0].name == "noise");
    CHECK(tasks.plan(1).values[0] == "5");
    const auto noise = [&](std::int64_t task) {
        return ordered_json::parse(tasks.job_text(task))["data"]["simulate"]["noise"];
    };
    CHECK(noise(0)["x"] == 0.01);
    CHECK_THAT(noise(1)["x"].get<double>(), tests::WithinRel(0.05, 1e-14));
    CHECK_THAT(noise(1)["y"].get<double>(), tests::WithinRel(0.015, 1e-14));
}

TEST_CASE("Jobs of a campaign are changed by name before anything varies", "[campaign]") {
    const apps::CampaignReading reading = read(R"({
      "kind": "coverage", "replicates": 1, "jobs": { "both": "henon.json", "x": "henon.json" },
      "changes": { "x": { "data": { "observe": ["x"] }, "estimate": { "parameters": { "b": null } } } } })");
    REQUIRE(reading.campaign);
    const apps::CampaignTasks tasks(*reading.campaign);
    REQUIRE(tasks.count() == 2);
    const auto both = ordered_json::parse(tasks.job_text(0));
    CHECK_FALSE(both["data"].contains("observe"));
    CHECK(both["estimate"]["parameters"].contains("b"));
    const auto changed = ordered_json::parse(tasks.job_text(1));
    CHECK(changed["data"]["observe"] == ordered_json::array({"x"}));
    CHECK(changed["data"]["simulate"] == both["data"]["simulate"]);
    CHECK(changed["estimate"]["parameters"].dump() == R"({"a":{"start":1.3}})");
}

TEST_CASE("The jobs of a campaign are all files that match a pattern, changed by a file", "[campaign]") {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder.path() / "jobs");
    tests::write_text(folder.path() / "jobs" / "one.json", henon_job);
    tests::write_text(folder.path() / "jobs" / "two.json", henon_job);
    tests::write_text(folder.path() / "changes.json", R"({ "two": { "seed": 5 } })");
    const apps::CampaignReading reading = apps::read_campaign(
        R"({ "kind": "coverage", "replicates": 1, "jobs": "jobs/*.json", "changes": "changes.json" })",
        folder.path() / "campaign.json");
    REQUIRE(reading.campaign);
    REQUIRE(reading.campaign->jobs.size() == 2);
    CHECK(reading.campaign->jobs[1].name == "two");
    CHECK(ordered_json::parse(reading.campaign->jobs[1].text)["seed"] == 5);
}

TEST_CASE("Every campaign in configs/campaigns is read", "[campaign]") {
    std::size_t campaigns = 0;
    for (const auto& entry :
         std::filesystem::directory_iterator(orbid::tests::source_folder() + "/configs/campaigns")) {
        if (entry.path().extension() != ".json") continue;
        CAPTURE(entry.path().string());
        const apps::CampaignReading reading = apps::read_campaign(apps::read_whole_file(entry.path()), entry.path());
        for (const apps::Problem& problem : reading.problems)
            UNSCOPED_INFO(apps::message(problem, entry.path().filename().string()));
        CHECK(reading.campaign);
        ++campaigns;
    }
    CHECK(campaigns >= 7);
}

TEST_CASE("The parameters of a grid are held, the others estimated", "[campaign]") {
    const apps::CampaignReading reading = read(R"({
      "kind": "profile_grid", "job": "henon.json", "grid": { "a": { "from": 1.3, "to": 1.5, "count": 3 } } })");
    REQUIRE(reading.campaign);
    const apps::CampaignTasks tasks(*reading.campaign);
    REQUIRE(tasks.count() == 3);
    const auto job = ordered_json::parse(tasks.job_text(2));
    CHECK(job["model"]["parameters"]["a"] == 1.5);
    CHECK_FALSE(job["estimate"]["parameters"].contains("a"));
    CHECK(job["estimate"]["parameters"].contains("b"));
}

TEST_CASE("A range meets both ends, and whole values stay whole", "[campaign]") {
    const apps::CampaignReading reading = read(R"({
      "kind": "sweep", "job": "henon.json", "vary": [
        { "key": "/data/simulate/sections", "range": { "from": 100, "to": 500, "count": 5 } },
        { "key": "/data/simulate/noise/x", "range": { "from": 1e-4, "to": 1e-2, "count": 3, "spacing": "log" } } ] })");
    REQUIRE(reading.campaign);
    const auto& factors = reading.campaign->factors;
    REQUIRE(factors[0].settings.size() == 5);
    CHECK(factors[0].settings[1][0].dump() == "200");
    CHECK_THAT(factors[1].settings[1][0].get<double>(), tests::WithinRel(1e-3, 1e-14));
    CHECK(factors[1].settings[2][0].get<double>() == 1e-2);
}

TEST_CASE("What is wrong with a campaign is told with its place", "[campaign]") {
    using Catch::Contains;
    const auto with = [](const std::string& rest) {
        return R"({ "kind": "sweep", "job": "henon.json", )" + rest + " }";
    };
    CHECK_THAT(problem(with(R"("vary": [ { "key": "/estimate/parametres/a/start", "values": [1] } ])")),
               Contains("campaign.json:1:1") && Contains("leads nowhere") && Contains("did you mean \"parameters\"?"));
    CHECK_THAT(problem(with(R"("vary": [ { "key": "/data/simulate/sektions", "values": [1] } ])")),
               Contains("the job of task 0") && Contains("/data/simulate/sektions: unknown key"));
    CHECK_THAT(
        problem(with(R"("vary": [ { "key": "/seed", "range": { "from": 1, "to": 2e9, "count": 1000000000 } } ])")),
        Contains("/vary/0/range") && Contains("1000000000"));
    CHECK_THAT(problem(with(
                   R"("replicates": 1000000000, "vary": [ { "key": "/data/simulate/sections", "values": [9, 8] } ])")),
               Contains("2e+09 tasks"));
    CHECK_THAT(problem(with(R"("vary": [ { "key": "/data/simulate/sections", "values": [9] },
                                         { "key": "/data/simulate", "values": [{}] } ])")),
               Contains("varies twice"));
    CHECK_THAT(problem(with(R"("vary": [ { "key": "/data/simulate/initiall", "multiply_by": [2] } ])")),
               Contains("/data/simulate/initiall") && Contains("no number there"));
    CHECK_THAT(problem(R"({ "kind": "coverage", "replicates": 1, "jobs": { "both": "henon.json" },
                            "changes": { "botj": { "seed": 2 } } })"),
               Contains("/changes") && Contains("no job \"botj\"") && Contains("did you mean \"both\"?"));
    CHECK_THAT(problem(with(R"("changes": { "henon": {} }, "vary": [ { "key": "/seed", "values": [1] } ])")),
               Contains("/changes"));
    CHECK_THAT(
        problem(with(R"("vary": [ { "key": "/estimate/parameters/a/start", "values": [1, "x"] } ])")),
        Contains("/vary: the job of task 1 (a_start = \"x\") is refused: /estimate/parameters/a/start: must be"));
    CHECK_THAT(problem(R"({ "kind": "sweep", "job": "henon.json" })"), Contains("needs \"vary\""));
    CHECK_THAT(problem(R"({ "kind": "sweep", "job": "absent.json" })"), Contains("does not exist"));
    CHECK_THAT(problem(R"({ "kind": "coverage", "job": "henon.json" })"), Contains("replicates"));
    CHECK_THAT(problem(R"({ "kind": "swep", "job": "henon.json" })"), Contains("did you mean \"sweep\"?"));
    CHECK_THAT(problem(R"({ "kind": "profile_grid", "job": "henon.json", "grid": { "q": [1] } })"), Contains("\"q\""));
    CHECK_THAT(problem(R"({ "kind": "records", "job": "henon.json", "records": "none/*.csv" })"),
               Contains("no file matches"));
    CHECK_THAT(problem(R"({ "kind": "bootstrap", "run": "nowhere", "replicates": 5 })"), Contains("no finished run"));
}

}  // namespace
}  // namespace orbid::campaign_test
