#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "apps/campaign/journal/journal.hpp"
#include "apps/documents/atomic_file.hpp"
#include "tests/apps/campaign/made_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::recover_test {
namespace {

using apps::Journal;
using apps::JournalDamaged;
using apps::JournalError;
using apps::TaskState;
using tests::ContainsSubstring;
using tests::TemporaryFolder;

constexpr std::int64_t tasks = 700;
constexpr std::int64_t ended = 600;
constexpr std::size_t page = 4096;

void write_file(const std::filesystem::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
}

/// Recovers, and checks that every row there is is right, and that numbers agree.
/// @return outcomes that were kept.
std::int64_t recover_and_check(const std::filesystem::path& file) {
    const auto made = tests::made_head(tasks);
    const auto found = Journal::recover(file, &made);
    CHECK(std::filesystem::exists(found.damaged));
    auto journal = Journal::open(file, Journal::Access::write);
    CHECK(journal.head().key == made.key);
    const auto missing = journal.missing();
    CHECK(found.lost_tasks == static_cast<std::int64_t>(missing.size()));
    for (const auto number : missing)
        journal.add_tasks(std::vector{tests::made_plan(number)});
    const auto counts = journal.counts();
    CHECK(counts.done + counts.failed == found.ended);
    CHECK(counts.waiting == tasks - found.ended);
    std::int64_t next = 0;
    bool right = true;
    journal.each_row([&](const Journal::Row& row) {
        right = right && row.plan.number == next && tests::same_plan(row.plan, tests::made_plan(next));
        if (row.outcome.state != TaskState::waiting)
            right = right && row.plan.number < ended && tests::same_outcome(row.outcome, tests::made_outcome(next));
        ++next;
    });
    CHECK(right);
    CHECK(next == tasks);
    // What waits can be stored, and nothing is missing then.
    for (const auto number : journal.waiting())
        journal.store(std::vector{tests::made_outcome(number)});
    CHECK(apps::uncompressed(journal.result(tasks - 1)) == tests::made_result(tasks - 1));
    CHECK_NOTHROW(journal.check());
    return found.ended;
}

/// Whether opening says that the journal is damaged; a clear word, and never another exception.
bool refused(const std::filesystem::path& file) {
    try {
        (void)Journal::open(file, Journal::Access::read);
    } catch (const JournalError& error) {
        CHECK_THAT(error.what(), ContainsSubstring(file.string()));
        return true;
    }
    return false;
}

TEST_CASE("a whole journal is recovered whole", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, tasks, ended);
    CHECK_FALSE(refused(file));
    CHECK(recover_and_check(file) == ended);
    const auto again = Journal::recover(file);
    CHECK(again.ended == tasks);
    CHECK(again.lost_outcomes == 0);
    CHECK(again.damaged.filename() == "campaign.damaged-2.sqlite");
}

TEST_CASE("any destroyed page is told when the journal is opened, and the others are recovered", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, tasks, ended);
    const std::string whole = apps::read_whole_file(file);
    REQUIRE(whole.size() % page == 0);
    std::mt19937 random(1);
    std::int64_t least = ended;
    for (std::size_t k = 0; k < whole.size() / page; ++k) {
        INFO("page " << k + 1);
        std::string bytes = whole;
        for (std::size_t at = k * page; at < (k + 1) * page; ++at)
            bytes[at] = static_cast<char>(random());
        write_file(file, bytes);
        CHECK(refused(file));
        least = std::min(least, recover_and_check(file));
        std::filesystem::remove(folder.path() / "campaign.damaged.sqlite");
    }
    // Of rows the shortest are results of 34 bytes: 120 on a page.
    CHECK(least > ended - 130);
}

TEST_CASE("destroyed bytes within rows are told or change nothing", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, tasks, ended);
    const std::string whole = apps::read_whole_file(file);
    std::mt19937 random(2);
    int told = 0;
    for (int k = 0; k < 60; ++k) {
        const std::size_t size = std::size_t{1} << k % 10;
        const std::size_t at = random() % (whole.size() - size);
        INFO("bytes from " << at << ", " << size << " of them");
        std::string bytes = whole;
        for (std::size_t j = 0; j < size; ++j)
            bytes[at + j] = static_cast<char>(random());
        write_file(file, bytes);
        told += refused(file);
        recover_and_check(file);
        std::filesystem::remove(folder.path() / "campaign.damaged.sqlite");
    }
    // Others fall into the unused part of a page.
    CHECK(told > 30);
}

TEST_CASE("a journal cut off anywhere is told, and its beginning is recovered", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, tasks, ended);
    const std::string whole = apps::read_whole_file(file);
    std::mt19937 random(3);
    for (int k = 0; k < 25; ++k) {
        const std::size_t size = k == 0 ? 0 : k == 1 ? 100 : random() % whole.size();
        INFO("the first " << size << " bytes");
        write_file(file, whole.substr(0, size));
        CHECK(refused(file));
        recover_and_check(file);
        std::filesystem::remove(folder.path() / "campaign.damaged.sqlite");
    }
}

TEST_CASE("outcomes in the log of a killed program are recovered, too", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    {
        auto journal = Journal::create(file, tests::made_head(tasks));
        journal.add_tasks(tests::made_plans(tasks));
        for (const auto& outcome : tests::made_outcomes(ended))
            journal.store(std::vector{outcome});
        // As a kill leaves them: copies made while the program has not closed them.
        for (const auto* suffix : {"", "-wal"})
            std::filesystem::copy_file(file.string() + suffix, (folder.path() / "killed.sqlite").string() + suffix);
    }
    const auto killed = folder.path() / "killed.sqlite";
    const auto log = folder.path() / "killed.sqlite-wal";
    REQUIRE(std::filesystem::file_size(log) > 100 * page);
    const std::string in_log = apps::read_whole_file(log);
    const std::string in_file = apps::read_whole_file(killed);
    CHECK(recover_and_check(killed) == ended);
    // Destroyed half way, the log counts up to there.
    std::filesystem::remove(folder.path() / "killed.damaged.sqlite-wal");
    std::filesystem::remove(folder.path() / "killed.damaged.sqlite");
    write_file(killed, in_file);
    std::string bytes = in_log;
    bytes.replace(bytes.size() / 2, 5, "noise");
    write_file(log, bytes);
    const auto kept = recover_and_check(killed);
    CHECK(kept > 100);
    CHECK(kept < ended);
}

TEST_CASE("without a word about its campaign nothing is recovered", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    write_file(file, std::string(50000, '\x0d'));
    CHECK_THROWS_WITH(Journal::recover(file), ContainsSubstring("nothing in") && ContainsSubstring("campaign.sqlite"));
    CHECK(apps::read_whole_file(file).size() == 50000);
    const auto head = tests::made_head(5);
    CHECK(Journal::recover(file, &head).lost_tasks == 5);
}

}  // namespace
}  // namespace orbid::recover_test
