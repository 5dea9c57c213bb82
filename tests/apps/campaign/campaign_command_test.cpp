#include <sstream>
#include <string>
#include <vector>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace orbid::campaign_command_test {
namespace {

using tests::json;
using tests::orbid_with;
using tests::Outcome;
using tests::Path;
using tests::TemporaryFolder;

json henon_campaign(int replicates) {
    return {{"kind", "coverage"},
            {"job",
             {{"model", {{"name", "henon"}, {"parameters", {{"a", 1.4}, {"b", 0.3}}}}},
              {"data",
               {{"simulate", {{"sections", 30}, {"initial", {{0.1, 0.1}}}, {"noise", {{"x", 0.01}, {"y", 0.003}}}}}}},
              {"estimate",
               {{"parameters", {{"a", {{"start", 1.38}}}, {"b", {{"start", 0.29}}}}},
                {"residuals", {{{"type", "series"}, {"interval", 1}}}}}}}},
            {"replicates", replicates}};
}

std::vector<std::vector<std::string>> rows(const std::string& csv) {
    std::vector<std::vector<std::string>> all;
    std::istringstream lines(csv);
    for (std::string line; std::getline(lines, line);) {
        std::istringstream cells(line);
        all.emplace_back();
        for (std::string cell; std::getline(cells, cell, ',');)
            all.back().push_back(cell);
    }
    return all;
}

/// Whether some output has all of these.
bool has(const std::string& text, const std::vector<std::string>& parts) {
    for (const std::string& part : parts)
        if (text.find(part) == std::string::npos) {
            UNSCOPED_INFO("\"" << part << "\" is missing in:\n" << text);
            return false;
        }
    return true;
}

TEST_CASE("A campaign is run, asked, exported, and each of its tasks can be run alone", "[campaign]") {
    const TemporaryFolder folder;
    const Path file = tests::write_job(folder.path() / "coverage.json", henon_campaign(8));
    const std::string out = (folder.path() / "out").string();
    const Outcome run = orbid_with({"campaign", file.string(), "--out", out, "--quiet"});
    CHECK(run.code == 0);
    CHECK(has(run.out, {"8 tasks", "8 done", "converged"}));
    CHECK(run.error.empty());
    CHECK(std::filesystem::exists(folder.path() / "out" / "campaign.sqlite"));

    const Outcome status = orbid_with({"campaign", "status", out});
    CHECK(status.code == 0);
    CHECK(status.out == run.out);

    const Outcome table = orbid_with({"campaign", "export", out});
    const auto cells = rows(table.out);
    REQUIRE(cells.size() == 9);
    REQUIRE(cells[0].size() > 10);
    CHECK(cells[0][0] == "number");
    CHECK(cells[0][1] == "seed");
    CHECK(cells[8][1] == "8");
    CHECK(has(orbid_with({"campaign", "export", out, "--table", "summary"}).out, {"a_coverage", "b_rms_z"}));

    // The job of a task, run alone, gives what the campaign has stored.
    const Outcome job = orbid_with({"campaign", "export", out, "--job", "3"});
    const Path alone = tests::write_text(folder.path() / "alone.json", job.out);
    REQUIRE(orbid_with({"run", alone.string(), "--quiet"}).code == 0);
    const Outcome result = orbid_with({"campaign", "export", out, "--result", "3"});
    CHECK(json::parse(result.out)["parameters"] ==
          tests::read_json(folder.path() / "alone" / "result.json")["parameters"]);
    CHECK(job.out.find("\"seed\": 4") != std::string::npos);

    // Nothing is run twice, and nothing of another campaign is mixed in.
    CHECK(orbid_with({"campaign", file.string(), "--out", out}).out == run.out);
    tests::write_job(file, henon_campaign(9));
    const Outcome other = orbid_with({"campaign", file.string(), "--out", out});
    CHECK(other.code == 2);
    CHECK(has(other.error, {"another campaign", "/replicates is 8 there, 9 in this one"}));
    CHECK(orbid_with({"campaign", "export", out}).out == table.out);
}

TEST_CASE("Tasks that cannot be run have failed with their reason, and are tried again when asked", "[campaign]") {
    const TemporaryFolder folder;
    json campaign = henon_campaign(1);
    campaign["kind"] = "sweep";
    // Two readings are fewer than the unknowns: the job is valid, its data are not.
    campaign["vary"] = {{{"key", "/data/simulate/sections"}, {"values", {30, 2}}}};
    const Path file = tests::write_job(folder.path() / "sweep.json", campaign);
    const Outcome run = orbid_with({"campaign", file.string(), "--quiet"});
    CHECK(run.code == 0);
    const std::string out = (folder.path() / "sweep").string();
    const auto cells = rows(orbid_with({"campaign", "export", out}).out);
    REQUIRE(cells.size() == 3);
    CHECK(has(orbid_with({"campaign", "export", out}).out, {"failed,data,3"}));
    CHECK(has(run.out, {"1 done", "1 failed"}));
    const Outcome again = orbid_with({"campaign", "retry", out, "--quiet", "--status", "crash"});
    CHECK(has(again.error, {"0 failed tasks are tried again"}));
    CHECK(has(orbid_with({"campaign", "retry", out, "--quiet"}).error, {"1 failed tasks are tried again"}));
    CHECK(has(orbid_with({"campaign", "export", out, "--times"}).out, {"attempts"}));
}

TEST_CASE("Campaigns are checked, and told from jobs", "[campaign]") {
    const TemporaryFolder folder;
    const Path file = tests::write_job(folder.path() / "coverage.json", henon_campaign(8));
    const Outcome check = orbid_with({"check", file.string()});
    CHECK(check.code == 0);
    CHECK(has(check.out, {"coverage", "tasks      8", "seeds      1 to 8"}));
    const Outcome run = orbid_with({"run", file.string()});
    CHECK(run.code == 2);
    CHECK(has(run.error, {"is a campaign: orbid campaign"}));
    CHECK(orbid_with({"campaign", "status", folder.path().string()}).code == 2);
    CHECK(orbid_with({"campaign", "status"}).code == 2);
    CHECK(orbid_with({"campaign", "stat", "x"}).code == 2);
    json wrong = henon_campaign(8);
    wrong["job"]["data"]["simulate"]["sektions"] = 3;
    tests::write_job(file, wrong);
    const Outcome refused = orbid_with({"campaign", file.string()});
    CHECK(refused.code == 2);
    CHECK(has(refused.error, {"coverage.json:", "/job", "the job of task 0", "sektions: unknown key"}));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "coverage"));
}

}  // namespace
}  // namespace orbid::campaign_command_test
