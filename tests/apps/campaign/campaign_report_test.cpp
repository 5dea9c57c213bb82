#include <fstream>
#include <string>

#include "apps/campaign/report/campaign_charts.hpp"
#include "apps/campaign/report/campaign_findings.hpp"
#include "apps/campaign/report/campaign_report.hpp"
#include "apps/documents/atomic_file.hpp"
#include "models/system/stopped.hpp"
#include "tests/apps/campaign/made_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::campaign_report_test {
namespace {

using apps::campaign_report_html;
using apps::Journal;
using tests::ContainsSubstring;
using tests::TemporaryFolder;

bool says(const std::string& page, const std::string& text) {
    return page.find(text) != std::string::npos;
}

/// The page of a campaign with tasks of which some have ended.
std::string page_of(std::int64_t tasks, std::int64_t ended, const apps::CampaignReportOptions& options = {}) {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, tasks, ended);
    return campaign_report_html(Journal::open(file, Journal::Access::read), options);
}

TEST_CASE("the report of a campaign says in short how it stands", "[apps][campaign]") {
    const auto page = page_of(330, 300);
    CHECK(says(page, "<h1>noise and seeds</h1>"));
    int covered = 0;
    int intervals = 0;
    for (const auto& outcome : tests::made_outcomes(300)) {
        if (outcome.exit_code != 0) continue;
        for (const auto& p : outcome.parameters) {
            intervals += !std::isnan(p.truth);
            covered += p.lower <= p.truth && p.truth <= p.upper;
        }
    }
    CHECK(says(page, fmt::format("270 of 330 tasks done; {:.3g} % of their intervals hold the truth; 10 % failed; "
                                 "30 tasks to go.",
                                 100.0 * covered / intervals)));
    CHECK(says(page, "30 tasks failed (data): no crossing in &quot;a&quot;, which is short"));
    CHECK(says(page, "30 tasks ended without a valid answer, 11.1 % of those done."));
    for (const auto* chapter : {"settings", "coverage", "dependence", "failures", "times", "origin"})
        CHECK(says(page, fmt::format("<section id=\"{}\"", chapter)));
    for (const auto* chart : {"coverage", "z", "bound", "against-0", "times"})
        CHECK(says(page, fmt::format("id=\"plot-{}\"", chart)));
    CHECK_FALSE(says(page, "against-1"));
    // Nothing is loaded: the only addresses are names of formats.
    CHECK_FALSE(says(page, "src=\"http"));
    CHECK_FALSE(says(page, "href=\"http"));
    CHECK_FALSE(says(page, "http-equiv=\"refresh\""));
    CHECK(page == page_of(330, 300));
}

TEST_CASE("a page renews itself while tasks wait, and says when it was written", "[apps][campaign]") {
    const auto page = page_of(30, 20, {.written = 1764000000.5, .refresh_s = 15});
    CHECK(says(page, "<meta http-equiv=\"refresh\" content=\"15\">"));
    CHECK(says(page, "Written 2025-11-24 16:00:00 UTC; this page asks for itself anew every 15 s while tasks wait."));
    const auto ended = page_of(30, 30, {.written = 1764000000.5, .refresh_s = 15});
    CHECK_FALSE(says(ended, "http-equiv=\"refresh\""));
    CHECK(says(ended, "Written 2025-11-24 16:00:00 UTC."));
    CHECK_FALSE(says(ended, "asks for itself"));
}

TEST_CASE("the report of a campaign that has not begun says so", "[apps][campaign]") {
    const auto page = page_of(12, 0);
    CHECK(says(page, "None of 12 tasks has ended yet."));
    for (const auto* chapter : {"coverage", "dependence", "failures", "times"})
        CHECK_FALSE(says(page, fmt::format("<section id=\"{}\"", chapter)));
}

TEST_CASE("without truths there is no chapter about coverage", "[apps][campaign]") {
    const TemporaryFolder folder;
    auto head = tests::made_head(40);
    head.kind = "sweep";
    auto journal = Journal::create(folder.path() / "campaign.sqlite", head);
    journal.add_tasks(tests::made_plans(40));
    for (auto outcome : tests::made_outcomes(40)) {
        for (auto& parameter : outcome.parameters)
            parameter.truth = parameter.bound = apps::TaskParameter::unknown;
        journal.store(std::vector{outcome});
    }
    const auto page = campaign_report_html(journal);
    CHECK_FALSE(says(page, "<section id=\"coverage\""));
    CHECK_FALSE(says(page, "hold the truth"));
    CHECK(says(page, "<section id=\"dependence\""));
}

TEST_CASE("tasks without estimates have a report, too", "[apps][campaign]") {
    const TemporaryFolder folder;
    auto head = tests::made_head(3);
    head.title.clear();
    head.varied = {{"file", ""}};
    auto journal = Journal::create(folder.path() / "campaign.sqlite", head);
    for (int number = 0; number < 3; ++number) {
        const std::string name = number == 1 ? R"("<script>alert(1)</script>")" : R"("a.csv")";
        journal.add_tasks(std::vector{apps::TaskPlan{number, "", {name}}});
        auto outcome = tests::made_outcome(number);
        outcome.parameters.clear();
        outcome.message = "</script><b>";
        if (number == 2) outcome.exit_code = 1;
        journal.store(std::vector{outcome});
    }
    const auto page = campaign_report_html(journal);
    CHECK(says(page, "<title>Campaign</title>"));
    CHECK_FALSE(says(page, "<script>alert"));
    CHECK_FALSE(says(page, "</script><b>"));
    CHECK(says(page, "&lt;script&gt;alert(1)"));
}

TEST_CASE("charts of a campaign show what the tasks gave", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 900, 900);
    const auto journal = Journal::open(file, Journal::Access::read);
    const auto findings = apps::campaign_findings(journal);
    REQUIRE(findings.groups.names() == std::vector<std::string>{"gamma", "omega", "sigma"});
    const auto coverage = apps::coverage_chart(findings);
    // all, and each of two parameters by setting; sigma has no truth
    REQUIRE(coverage.views.size() == 3);
    CHECK(coverage.views[1].y.names.size() == 3);
    const auto z = apps::z_chart(findings);
    REQUIRE(z.views.size() == 2);
    const auto& bars = z.views[0].layers[0];
    double area = 0;
    for (std::size_t k = 0; k < bars.y.size(); ++k)
        area += bars.y[k] * (bars.x[k + 1] - bars.x[k]);
    CHECK_THAT(area, tests::WithinRel(1.0, 1e-12));  // none is beyond: made_z() keeps within 1.74
    // Uniform between -sqrt(3) and sqrt(3): density 1 / (2 sqrt(3)) in the middle.
    CHECK_THAT(bars.y[bars.y.size() / 2], tests::WithinRel(0.2887, 0.1));
    // More than 500: bands at the three values of noise.
    const auto bands = apps::dependence_chart(findings, 0);
    REQUIRE(bands.views.size() == 3);
    const auto& wide = bands.views[0].layers[0];
    REQUIRE(wide.kind == apps::LayerKind::band);
    CHECK(wide.x == std::vector<double>{0.01, 0.02, 0.05});
    // The middle 95 % of an even spread within sqrt(3) noise.
    CHECK_THAT(wide.upper[2] - 0.3, tests::WithinRel(0.95 * std::sqrt(3.0) * 0.05, 0.05));
    const auto bound = apps::bound_chart(findings);
    REQUIRE(bound.views.size() == 2);
    for (const double ratio : bound.views[0].layers[1].x)
        CHECK_THAT(ratio, tests::WithinRel(1 / 0.9, 0.05));
}

TEST_CASE("a wide campaign has a page of bounded size", "[apps][campaign]") {
    const TemporaryFolder folder;
    auto head = tests::made_head(5000);
    head.varied = {{"noise", "/a"}, {"draw", "/b"}, {"seed", "/seed", true}};
    auto journal = Journal::create(folder.path() / "campaign.sqlite", head);
    std::vector<apps::TaskPlan> plans;
    std::vector<apps::TaskOutcome> outcomes;
    for (int number = 0; number < 5000; ++number) {
        // Each its own setting, truths that differ, and messages all different.
        plans.push_back({number, "", {std::to_string(number % 7), fmt::format("{}", 1 + number * 0.1), "1"}, 1});
        auto outcome = tests::made_outcome(number);
        for (auto& parameter : outcome.parameters)
            parameter.truth += number;
        if (outcome.exit_code != 0) outcome.message = std::string(1 + number % 50, 'x') + std::to_string(number);
        outcomes.push_back(std::move(outcome));
    }
    journal.add_tasks(plans);
    journal.store(outcomes);
    const auto page = campaign_report_html(journal);
    CHECK(page.size() < 5'000'000);
    CHECK(says(page, "More than 1\u202f000 settings"));
    CHECK(says(page, "γ − truth"));
    CHECK_THROWS_AS(campaign_report_html(journal, {.interrupted = [] { return true; }}), models::Stopped);
}

TEST_CASE("the report of a running campaign is written beside it", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto page = folder.path() / "report.html";
    tests::make_campaign(folder.path() / "campaign.sqlite", 20, 0);
    auto journal = Journal::open(folder.path() / "campaign.sqlite", Journal::Access::write);
    {
        apps::LiveReport report(journal, folder.path());
        report.renew();
        journal.store(tests::made_outcomes(5));
        report.renew();  // too early: nothing is begun
    }
    CHECK(says(apps::read_whole_file(page), "content=\"10\""));
    journal.store(tests::made_outcomes(20));
    apps::LiveReport(journal, folder.path()).finish();
    CHECK(says(apps::read_whole_file(page), "18 of 20 tasks done"));
    CHECK_FALSE(says(apps::read_whole_file(page), "http-equiv=\"refresh\""));
    CHECK_THROWS_AS(apps::write_campaign_report(journal, folder.path() / "none" / "report.html"), std::runtime_error);
}

}  // namespace
}  // namespace orbid::campaign_report_test
