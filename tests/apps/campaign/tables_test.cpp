#include <algorithm>
#include <cmath>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "apps/campaign/tables/binomial_interval.hpp"
#include "apps/campaign/tables/campaign_status.hpp"
#include "apps/campaign/tables/campaign_table.hpp"
#include "apps/campaign/tables/group_statistics.hpp"
#include "models/system/stopped.hpp"
#include "tests/apps/campaign/made_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::tables_test {
namespace {

using apps::Journal;
using tests::ContainsSubstring;
using tests::TemporaryFolder;

using apps::CampaignTable;

std::string written(CampaignTable table, const Journal& journal, bool times = false) {
    std::ostringstream out;
    apps::write_campaign_table(journal, out, {.table = table, .times = times});
    return out.str();
}

/// Lines of a table whose cells hold no line ends; cells are parted outside of quotes.
std::vector<std::vector<std::string>> cells_of(const std::string& text) {
    std::vector<std::vector<std::string>> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
        auto& cells = lines.emplace_back(1);
        bool quoted = false;
        for (const char c : line) {
            if (c == '"') quoted = !quoted;
            if (c == ',' && !quoted) {
                cells.emplace_back();
            } else {
                cells.back() += c;
            }
        }
    }
    return lines;
}

TEST_CASE("the table of tasks has what was stored, to the bit", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 30, 25);
    const auto journal = Journal::open(file, Journal::Access::read);
    const auto lines = cells_of(written(CampaignTable::tasks, journal));
    REQUIRE(lines.size() == 31);
    std::ostringstream heading;
    for (const auto& cell : lines[0])
        heading << cell << ' ';
    CHECK(heading.str() ==
          "number noise seed state status exit_code objective gamma gamma_sd gamma_lower gamma_upper gamma_truth "
          "gamma_bound omega omega_sd omega_lower omega_upper omega_truth omega_bound sigma sigma_sd sigma_lower "
          "sigma_upper message ");
    for (int number = 0; number < 30; ++number) {
        const auto& line = lines[static_cast<std::size_t>(number + 1)];
        REQUIRE(line.size() == lines[0].size());
        const auto outcome = tests::made_outcome(number);
        CHECK(line[0] == std::to_string(number));
        CHECK(line[2] == std::to_string(number / 3));
        if (number >= 25) {
            CHECK(line[3] == "waiting");
            CHECK(std::all_of(line.begin() + 4, line.end(), [](const auto& cell) { return cell.empty(); }));
        } else if (number % 10 == 3) {
            CHECK(line[3] == "failed");
            CHECK(line.back() ==
                  fmt::format("\"no crossing in \"\"{}\"\", which is short\"", number == 13 ? "b" : "a"));
            CHECK(line[7].empty());
        } else {
            CHECK(std::stod(line[6]) == outcome.objective);
            CHECK(std::stod(line[7]) == outcome.parameters[0].value);
            CHECK(std::stod(line[18]) == outcome.parameters[1].bound);
            CHECK(line[21].empty());
        }
    }
}

TEST_CASE("tables do not depend on who ran the tasks, when, and in which order", "[apps][campaign]") {
    const TemporaryFolder folder;
    tests::make_campaign(folder.path() / "campaign.sqlite", 40, 40);
    {
        auto other = Journal::create(folder.path() / "other.sqlite", tests::made_head(40));
        auto plans = tests::made_plans(40);
        auto outcomes = tests::made_outcomes(40);
        std::mt19937 random(1);
        std::shuffle(plans.begin(), plans.end(), random);
        std::shuffle(outcomes.begin(), outcomes.end(), random);
        other.add_tasks(plans);
        for (auto& outcome : outcomes) {
            outcome.host = "elsewhere";
            outcome.rank += 1;
            outcome.started += 1e5;
            outcome.seconds *= 2;
            outcome.processor_seconds *= 3;
            other.store(std::vector{outcome});
        }
        CHECK(other.retry() == 4);
        for (const auto& outcome : outcomes)
            if (outcome.state == apps::TaskState::failed) other.store(std::vector{outcome});
    }
    const auto first = Journal::open(folder.path() / "campaign.sqlite", Journal::Access::read);
    const auto second = Journal::open(folder.path() / "other.sqlite", Journal::Access::read);
    for (const auto table : {CampaignTable::tasks, CampaignTable::parameters, CampaignTable::summary}) {
        CHECK(written(table, first) == written(table, second));
        CHECK(written(table, first, true) != written(table, second, true));
    }
    const auto lines = cells_of(written(CampaignTable::tasks, second, true));
    const auto column = [&lines](const std::string& name) {
        return static_cast<std::size_t>(std::find(lines[0].begin(), lines[0].end(), name) - lines[0].begin());
    };
    CHECK(lines[4][column("attempts")] == "2");
    CHECK(lines[5][column("attempts")] == "1");
    CHECK(lines[5][column("host")] == "elsewhere");
    CHECK(std::stod(lines[5][column("seconds")]) == 2 * tests::made_outcome(4).seconds);
}

TEST_CASE("columns of equal names are told apart, and texts lose their quotes", "[apps][campaign]") {
    const TemporaryFolder folder;
    auto head = tests::made_head(1);
    head.varied = {{"gamma", "/a"}, {"status", "/b"}, {"file", ""}};
    auto journal = Journal::create(folder.path() / "campaign.sqlite", head);
    journal.add_tasks(std::vector{apps::TaskPlan{0, "", {"0.1", "[1,2]", R"("a, \"b\".csv")"}}});
    journal.store(std::vector{tests::made_outcome(0)});
    const auto text = written(CampaignTable::tasks, journal);
    CHECK_THAT(text, ContainsSubstring("number,gamma_varied,status_varied,file,state,status"));
    CHECK_THAT(text, ContainsSubstring("\n0,0.1,\"[1,2]\",\"a, \"\"b\"\".csv\",done,converged,0,0.5,"));
    CHECK_THAT(
        written(CampaignTable::parameters, journal),
        ContainsSubstring("number,gamma,status_varied,file,status,parameter,value,sd,lower,upper,truth,bound\n"));
}

TEST_CASE("the long table has one row for each parameter", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 20, 15);
    const auto lines = cells_of(written(CampaignTable::parameters, Journal::open(file, Journal::Access::read)));
    // 15 ended, 2 of them failed
    REQUIRE(lines.size() == 1 + 3 * 13);
    const auto outcome = tests::made_outcome(1);
    CHECK(lines[5][4] == "omega");
    CHECK(std::stod(lines[5][5]) == outcome.parameters[1].value);
    CHECK(std::stod(lines[5][10]) == outcome.parameters[1].bound);
    CHECK(lines[6][9].empty());
}

TEST_CASE("the summary has the statistics of each setting", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 330, 300);
    const auto lines = cells_of(written(CampaignTable::summary, Journal::open(file, Journal::Access::read)));
    REQUIRE(lines.size() == 4);
    const auto value = [&lines](std::size_t line, const std::string& name) {
        const auto found = std::find(lines[0].begin(), lines[0].end(), name);
        REQUIRE(found != lines[0].end());
        return std::stod(lines[line][static_cast<std::size_t>(found - lines[0].begin())]);
    };
    for (std::size_t group = 0; group < 3; ++group) {
        // By plain sums over what was stored.
        std::vector<double> values;
        double z2 = 0;
        int covered = 0;
        for (int number = static_cast<int>(group); number < 300; number += 3) {
            const auto outcome = tests::made_outcome(number);
            if (outcome.exit_code != 0) continue;
            const auto& p = outcome.parameters[1];
            values.push_back(p.value);
            z2 += (p.value - 2.0) * (p.value - 2.0) / (p.sd * p.sd);
            covered += std::abs(p.value - 2.0) <= 1.6 * p.sd;
        }
        const auto n = static_cast<double>(values.size());
        double mean = 0;
        for (const double x : values)
            mean += x / n;
        double variance = 0;
        for (const double x : values)
            variance += (x - mean) * (x - mean) / (n - 1);
        const std::size_t line = group + 1;
        CHECK(value(line, "noise") == (group == 0 ? 0.01 : group == 1 ? 0.02 : 0.05));
        CHECK(value(line, "tasks") == 110);
        CHECK(value(line, "done") + value(line, "failed") == 100);
        CHECK(value(line, "valid") == n);
        CHECK(value(line, "converged") == n);
        CHECK(value(line, "omega_count") == n);
        CHECK_THAT(value(line, "omega_mean"), tests::WithinRel(mean, 1e-12));
        CHECK_THAT(value(line, "omega_sd"), tests::WithinRel(std::sqrt(variance), 1e-9));
        CHECK_THAT(value(line, "omega_mean_sd"), tests::WithinRel(value(line, "noise"), 1e-12));
        CHECK_THAT(value(line, "omega_rms_z"), tests::WithinRel(std::sqrt(z2 / n), 1e-9));
        CHECK_THAT(value(line, "omega_rms_over_bound"), tests::WithinRel(std::sqrt(z2 / n) / 0.9, 1e-9));
        CHECK_THAT(value(line, "omega_coverage"), tests::WithinRel(covered / n, 1e-12));
        CHECK(value(line, "omega_coverage_lower") < covered / n);
        CHECK(value(line, "omega_coverage_upper") > covered / n);
    }
    CHECK(std::find(lines[0].begin(), lines[0].end(), "sigma_coverage") == lines[0].end());
}

TEST_CASE("intervals of proportions are those of Clopper and Pearson", "[apps][campaign]") {
    // Closed forms: without events 1 - (tail)^(1/n), and its mirror.
    const auto none = apps::binomial_interval(0, 20);
    CHECK(none.lower == 0.0);
    CHECK_THAT(none.upper, tests::WithinRel(1 - std::pow(0.025, 1 / 20.0), 1e-12));
    const auto all = apps::binomial_interval(20, 20);
    CHECK_THAT(all.lower, tests::WithinRel(std::pow(0.025, 1 / 20.0), 1e-12));
    CHECK(all.upper == 1.0);
    // By the definition: each end leaves 2.5 % beyond what was seen.
    const auto some = apps::binomial_interval(47, 50);
    const auto tail_from = [](double p, int from, int to) {
        double sum = 0;
        for (int k = from; k <= to; ++k)
            sum += std::exp(std::lgamma(51) - std::lgamma(k + 1) - std::lgamma(51 - k) + k * std::log(p) +
                            (50 - k) * std::log1p(-p));
        return sum;
    };
    CHECK_THAT(tail_from(some.lower, 47, 50), tests::WithinRel(0.025, 1e-9));
    CHECK_THAT(tail_from(some.upper, 0, 47), tests::WithinRel(0.025, 1e-9));
    CHECK(apps::binomial_interval(0, 0).upper == 1.0);
    CHECK_THROWS_AS(apps::binomial_interval(3, 2), std::invalid_argument);
}

TEST_CASE("the status says where a campaign stands and what failed", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 1100, 1050);
    const auto journal = Journal::open(file, Journal::Access::read);
    const auto status = apps::read_campaign_status(journal);
    std::int64_t intervals = 0;
    std::int64_t covered = 0;
    for (const auto& outcome : tests::made_outcomes(1050)) {
        if (outcome.exit_code != 0) continue;
        for (const auto& p : outcome.parameters) {
            if (std::isnan(p.truth)) continue;
            ++intervals;
            covered += p.lower <= p.truth && p.truth <= p.upper;
        }
    }
    CHECK(status.intervals == intervals);
    CHECK(status.covered == covered);
    REQUIRE(status.reasons.size() == 2);
    CHECK(status.reasons[0].count == 105);
    CHECK(status.reasons[0].tasks.front() == 3);
    CHECK(status.reasons[0].message == "no crossing in \"a\", which is short");
    CHECK(status.reasons[1].status == "not converged");
    const auto text = apps::status_text(journal.head(), status);
    CHECK_THAT(text, ContainsSubstring("noise and seeds\ngrid: 1 100 tasks, 945 done, 105 failed, 50 waiting\n"));
    CHECK_THAT(text, ContainsSubstring("no crossing in \"a\", which is short"));
    CHECK_THAT(text, ContainsSubstring("coverage: ") && ContainsSubstring("nominal 95 %"));
    CHECK(apps::message_pattern("step 12 of 3.5e-7 in \"file 3\" at t1") == "step # of # in \"\" at t#");
}

TEST_CASE("nothing done is said, and no table is empty of its heading", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 2, 0);
    const auto journal = Journal::open(file, Journal::Access::read);
    CHECK(apps::campaign_status(journal) == "noise and seeds\ngrid: 2 tasks, 0 done, 0 failed, 2 waiting\n");
    CHECK(written(CampaignTable::tasks, journal) ==
          "number,noise,seed,state,status,exit_code,objective,message\n0,0.01,0,waiting,,,,\n1,0.02,0,waiting,,,,\n");
    CHECK(written(CampaignTable::summary, journal) ==
          "noise,tasks,done,converged,valid,failed\n0.01,1,0,0,0,0\n0.02,1,0,0,0,0\n");
    std::ostringstream out;
    CHECK_THROWS_AS(apps::write_campaign_table(journal, out, {.interrupted = [] { return true; }}), models::Stopped);
    out.setstate(std::ios::badbit);
    CHECK_THROWS_WITH(apps::write_campaign_table(journal, out), ContainsSubstring("cannot be written"));
}

}  // namespace
}  // namespace orbid::tables_test
