// Starting campaigns as a user begins with them: the commands in their comments first, then the campaign.

#include "apps/program/starting/starting_campaign.hpp"

#include <cmath>
#include <cstdlib>
#include <sstream>

#include "apps/campaign/engine/campaign_run.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace orbid::starting_campaign_test {
namespace {

using apps::Journal;
using tests::Path;
using tests::TemporaryFolder;

/// Commands that a campaign's comments hold, each on a line of its own.
std::string commands_in(const std::string& campaign) {
    std::istringstream lines(campaign);
    std::string commands;
    for (std::string line; std::getline(lines, line);)
        if (line.starts_with("//     ")) commands += line.substr(7) + "\n";
    return commands;
}

/// Exit code of lines of sh in a folder, with the program of this build as orbid.
int shell(const Path& folder, const std::string& lines) {
    const Path program(ORBID_PROGRAM);
    tests::write_text(folder / "lines.sh", "set -e\nexport PATH='" + program.parent_path().string() + "':$PATH\ncd '" +
                                               folder.string() + "'\n" + lines);
    return std::system(("sh '" + (folder / "lines.sh").string() + "' > /dev/null 2>&1").c_str());
}

TEST_CASE("every starting campaign runs to its end", "[apps][campaign]") {
    for (const std::string& kind : apps::starting_campaign_kinds()) {
        CAPTURE(kind);
        const TemporaryFolder folder;
        const std::string text = apps::starting_campaign(kind);
        CHECK(tests::orbid_with({"new", "campaign", kind}).out == text);
        const bool needs_more = kind == "bootstrap" || kind == "compare_models" || kind == "records";
        CHECK(commands_in(text).empty() != needs_more);
        REQUIRE(shell(folder.path(), "orbid new campaign " + kind + " > campaign.json\n" + commands_in(text) +
                                         "orbid campaign campaign.json --quiet\n") == 0);
        const Journal journal = Journal::open(folder.path() / "campaign" / apps::journal_name, Journal::Access::read);
        CHECK(journal.head().kind == kind);
        CHECK(journal.counts().done == journal.head().tasks);
        CHECK(journal.head().tasks >= 3);
        CHECK(journal.head().tasks <= 40);
        journal.each_row([&](const Journal::Row& row) {
            CAPTURE(row.plan.number);
            CHECK(row.outcome.status == "converged");
            REQUIRE_FALSE(row.outcome.parameters.empty());
            // Records are made with 30, which is found to 1 % even beside the wrong friction.
            const auto& w0sq = row.outcome.parameters.front();
            CHECK(w0sq.name == "w0sq");
            CHECK_THAT(w0sq.value, tests::WithinRel(30.0, 0.01));
            const bool has_truth = kind != "compare_models" && kind != "records";
            CHECK(std::isnan(w0sq.truth) != has_truth);
        });
    }
}

TEST_CASE("a kind of campaign that there is not is refused", "[apps][campaign]") {
    const tests::Outcome refused = tests::orbid_with({"new", "campaign", "covrage"});
    CHECK(refused.code == 2);
    CHECK_THAT(refused.error, tests::ContainsSubstring("\"covrage\"; kinds: sweep, coverage, bootstrap"));
    CHECK(tests::orbid_with({"new", "campaign"}).out == apps::starting_campaign("sweep"));
}

}  // namespace
}  // namespace orbid::starting_campaign_test
