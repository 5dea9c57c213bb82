#include "apps/campaign/journal/journal.hpp"

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <string>

#include "apps/campaign/journal/sqlite.hpp"
#include "tests/apps/campaign/made_campaign.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::journal_test {
namespace {

using apps::Journal;
using apps::JournalError;
using apps::TaskState;
using tests::ContainsSubstring;
using tests::made_head;
using tests::made_outcome;
using tests::made_outcomes;
using tests::made_plans;
using tests::TemporaryFolder;

/// What a program prints to standard output.
std::string output_of(const std::string& command) {
    std::string out;
    FILE* pipe = ::popen(command.c_str(), "r");
    REQUIRE(pipe != nullptr);
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe))
        out += static_cast<char>(c);
    CHECK(::pclose(pipe) == 0);
    return out;
}

TEST_CASE("a journal gives back what was stored", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 60, 50);
    const auto journal = Journal::open(file, Journal::Access::read);
    CHECK(journal.head().title == "noise and seeds");
    CHECK(journal.head().document == "{\"tasks\": \"all\"}\n");
    CHECK(journal.head().varied[1].pointer == "/data/simulate/seed");
    CHECK(journal.added() == 60);
    CHECK(journal.missing().empty());
    const auto counts = journal.counts();
    CHECK(counts.waiting == 10);
    CHECK(counts.failed == 5);
    CHECK(counts.done == 45);
    CHECK(counts.processor_seconds == 50.0);
    CHECK(journal.waiting() == std::vector<std::int64_t>{50, 51, 52, 53, 54, 55, 56, 57, 58, 59});
    std::int64_t number = 0;
    journal.each_row([&number](const Journal::Row& row) {
        CHECK(tests::same_plan(row.plan, tests::made_plan(number)));
        CHECK(row.attempts == (number < 50 ? 1 : 0));
        if (number < 50) {
            CHECK(tests::same_outcome(row.outcome, made_outcome(number)));
        } else {
            CHECK(row.outcome.state == TaskState::waiting);
        }
        ++number;
    });
    CHECK(number == 60);
    CHECK(apps::uncompressed(journal.result(7)) == tests::made_result(7));
    CHECK(journal.result(3).empty());
    CHECK(journal.result(55).empty());
}

TEST_CASE("a journal is made where making one was interrupted", "[apps][campaign]") {
    const TemporaryFolder folder;
    // An empty file, and one that holds no table yet: killed before the first transaction was there.
    const auto nothing = folder.path() / "nothing.sqlite", begun = folder.path() / "begun.sqlite";
    std::ofstream(nothing).close();
    {
        apps::SqliteFile file(begun, apps::SqliteFile::Mode::create);
        file.run("PRAGMA journal_mode=WAL");
    }
    for (const auto& file : {nothing, begun}) {
        CAPTURE(file.filename().string());
        CHECK_FALSE(Journal::is_begun(file));
        { (void)Journal::create(file, made_head(3)); }
        CHECK(Journal::is_begun(file));
        CHECK(Journal::open(file, Journal::Access::read).head().title == made_head(3).title);
        CHECK_THROWS_AS(Journal::create(file, made_head(3)), JournalError);
    }
}

TEST_CASE("what varies and keys come back as they were, whatever they are", "[apps][campaign]") {
    const TemporaryFolder folder;
    auto head = made_head(2);
    head.varied = {{"seed \"x\"", ""}, {"list", "/a"}, {"object", "/b"}, {"task", "/c"}};
    auto journal = Journal::create(folder.path() / "campaign.sqlite", head);
    const apps::TaskPlan odd{.number = 1,
                             .key = "no digits",
                             .values = {R"("a,]\"b\\")", "[1, [2,3]]", R"({"k": [",", {}]})", "null"},
                             .seed = {}};
    journal.add_tasks(std::vector{odd});
    journal.each_row([&odd](const Journal::Row& row) { CHECK(tests::same_plan(row.plan, odd)); });
    CHECK(journal.missing() == std::vector<std::int64_t>{0});
    auto wrong = odd;
    wrong.number = 0;
    wrong.values[0] = "a";
    CHECK_THROWS_WITH(journal.add_tasks(std::vector{wrong}), ContainsSubstring("no JSON: a"));
    wrong.values = {"1"};
    CHECK_THROWS_WITH(journal.add_tasks(std::vector{wrong}), ContainsSubstring("1 values of 4 things"));
    CHECK_THROWS_WITH(journal.add_tasks(std::vector{odd}), ContainsSubstring("task 1 is added twice"));
    wrong = odd;
    wrong.number = 2;
    CHECK_THROWS_WITH(journal.add_tasks(std::vector{wrong}), ContainsSubstring("task 2 of a campaign of 2 tasks"));
    CHECK(journal.added() == 1);
}

TEST_CASE("failed tasks wait again, and attempts are counted", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 30, 30);
    auto journal = Journal::open(file, Journal::Access::write);
    CHECK(journal.retry("crash") == 0);
    CHECK(journal.retry("data") == 3);
    CHECK(journal.waiting() == std::vector<std::int64_t>{3, 13, 23});
    journal.each_row([](const Journal::Row& row) {
        CHECK(row.attempts == 1);
        if (row.plan.number == 13) CHECK_THAT(row.outcome.message, ContainsSubstring("no crossing in \"b\""));
    });
    auto better = made_outcome(14);
    better.number = 13;
    journal.store(std::vector{better});
    CHECK(journal.waiting() == std::vector<std::int64_t>{3, 23});
    journal.each_row([&better](const Journal::Row& row) {
        if (row.plan.number != 13) return;
        CHECK(row.attempts == 2);
        CHECK(tests::same_outcome(row.outcome, better));
    });
    CHECK_NOTHROW(journal.check());
    better.number = 30;
    CHECK_THROWS_WITH(journal.store(std::vector{better}), ContainsSubstring("there is no task 30"));
    better.number = 2;
    better.state = TaskState::waiting;
    CHECK_THROWS_WITH(journal.store(std::vector{better}), ContainsSubstring("is that it waits"));
}

TEST_CASE("Python reads a journal as documented", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 40, 35);
    const std::string script = R"(
import sqlite3, sys, zlib
db = sqlite3.connect('file:' + sys.argv[1] + '?mode=ro', uri=True)
print(db.execute('PRAGMA integrity_check').fetchone()[0])
print(db.execute("SELECT value FROM campaign WHERE key='title'").fetchone()[0])
print(db.execute('SELECT position, name, pointer FROM varied ORDER BY 1').fetchall())
print(db.execute('SELECT state, count(*) FROM task GROUP BY state ORDER BY 1').fetchall())
print(db.execute('SELECT key, seed, status FROM task WHERE number=4').fetchone())
print(db.execute("SELECT value FROM choice WHERE task=4 AND name='noise'").fetchone())
print(db.execute('SELECT * FROM choices WHERE task=4').fetchone())
print(zlib.decompress(db.execute('SELECT content FROM result WHERE task=7').fetchone()[0]).decode(), end='')
print(db.execute("SELECT count(*), sum(covered), avg(z*z) FROM parameter WHERE name='gamma'").fetchone())
print(db.execute("SELECT lower IS NULL, z IS NULL FROM parameter WHERE name='sigma' AND task=7").fetchone())
)";
    std::ofstream(folder.path() / "read.py") << script;
    const std::string said = output_of("python3 " + (folder.path() / "read.py").string() + " " + file.string());
    int count = 0;
    int covered = 0;
    double squares = 0;
    for (const auto& outcome : made_outcomes(35)) {
        if (outcome.parameters.empty()) continue;
        const auto& p = outcome.parameters[0];
        ++count;
        covered += p.lower <= p.truth && p.truth <= p.upper;
        squares += std::pow((p.value - p.truth) / p.sd, 2);
    }
    const std::string expected = fmt::format(
        "ok\nnoise and seeds\n[(0, 'noise', '/data/simulate/noise'), (1, 'seed', '/data/simulate/seed')]\n"
        "[('done', 31), ('failed', 4), ('waiting', 5)]\n('{}', 1, 'not converged')\n(0.02,)\n(4, 0.02, 1)\n{}({}, {}, ",
        apps::sha256("4"), tests::made_result(7), count, covered);
    CHECK(said.substr(0, expected.size()) == expected);
    CHECK_THAT(std::stod(said.substr(expected.size())), tests::WithinRel(squares / count, 1e-12));
    CHECK_THAT(said, ContainsSubstring("(1, 1)\n"));
}

TEST_CASE("one program writes a journal at a time, and a killed one does not block it", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 10, 0);
    int told[2];
    REQUIRE(::pipe(told) == 0);
    const pid_t child = ::fork();
    if (child == 0) {
        auto journal = Journal::open(file, Journal::Access::write);
        journal.store(made_outcomes(4));
        (void)!::write(told[1], "x", 1);
        while (true)
            ::pause();
    }
    char byte = 0;
    REQUIRE(::read(told[0], &byte, 1) == 1);
    std::array<char, 256> host{};
    ::gethostname(host.data(), host.size() - 1);
    CHECK_THROWS_WITH(Journal::open(file, Journal::Access::write),
                      ContainsSubstring(fmt::format("is being written by process {} on {}", child, host.data())));
    CHECK(Journal::open(file, Journal::Access::read).counts().waiting == 6);
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    auto journal = Journal::open(file, Journal::Access::write);
    CHECK(journal.counts().waiting == 6);
    CHECK_THROWS_AS(Journal::open(file, Journal::Access::write), JournalError);
    ::close(told[0]);
    ::close(told[1]);
}

TEST_CASE("a full disk is said, and the journal stays whole", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    tests::make_campaign(file, 3000, 0);
    const auto size = std::filesystem::file_size(file);
    const pid_t child = ::fork();
    if (child == 0) {
        // A file that may grow no further: writing fails as on a full disk, if the signal is ignored.
        ::signal(SIGXFSZ, SIG_IGN);
        int stored = 0;
        try {
            auto journal = Journal::open(file, Journal::Access::write);
            const rlimit limit{size + 200000, size + 200000};
            ::setrlimit(RLIMIT_FSIZE, &limit);
            for (; stored < 3000; ++stored)
                journal.store(std::vector{made_outcome(stored)});
        } catch (const JournalError& error) {
            std::ofstream(folder.path() / "said") << stored << ' ' << error.what();
            ::_exit(0);
        }
        ::_exit(1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    REQUIRE(status == 0);
    std::ifstream said(folder.path() / "said");
    int stored = 0;
    std::string text;
    said >> stored;
    std::getline(said, text);
    CHECK(stored > 0);
    CHECK_THAT(text, ContainsSubstring("campaign.sqlite") && ContainsSubstring("what was stored before is whole"));
    auto journal = Journal::open(file, Journal::Access::write);
    CHECK(journal.counts().done + journal.counts().failed == stored);
    journal.store(std::vector{made_outcome(stored)});
    CHECK_NOTHROW(journal.check());
}

TEST_CASE("what is no journal is refused by name", "[apps][campaign]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "campaign.sqlite";
    const auto opened = [&file] { (void)Journal::open(file, Journal::Access::read); };
    CHECK_THROWS_WITH(opened(), ContainsSubstring("cannot read") && ContainsSubstring("No such file"));
    std::ofstream(file) << std::string(5000, 'x');
    CHECK_THROWS_WITH(opened(), ContainsSubstring("is not a journal, or its first page is destroyed"));
    std::filesystem::remove(file);
    apps::SqliteFile(file, apps::SqliteFile::Mode::create).run("CREATE TABLE a(b)");
    CHECK_THROWS_WITH(opened(), ContainsSubstring("a file of SQLite, but not the journal of a campaign"));
    std::filesystem::remove(file);
    tests::make_campaign(file, 1, 0);
    CHECK_THROWS_WITH(Journal::create(file, made_head(1)), ContainsSubstring("exists already"));
    apps::SqliteFile(file, apps::SqliteFile::Mode::write).run("PRAGMA user_version=2");
    CHECK_THROWS_WITH(opened(), ContainsSubstring("format 2; this program reads format 1"));
}

TEST_CASE("compression is that of zlib, and damage is told", "[apps][campaign]") {
    std::string text;
    for (int k = 0; k < 30000; ++k)
        text += std::to_string(k * 7919 % 10007);
    for (const std::string& bytes : {std::string(), std::string("a\0b", 3), text})
        CHECK(apps::uncompressed(apps::compressed(bytes)) == bytes);
    auto stream = apps::compressed(text);
    CHECK(stream.size() < text.size() * 6 / 10);  // of digits
    CHECK_THROWS_WITH(apps::uncompressed(stream.substr(0, stream.size() / 2)), ContainsSubstring("end too early"));
    CHECK_THROWS_WITH(apps::uncompressed(stream + "x"), ContainsSubstring("followed by other bytes"));
    stream[stream.size() / 2] = static_cast<char>(stream[stream.size() / 2] ^ 1);
    CHECK_THROWS_WITH(apps::uncompressed(stream), ContainsSubstring("damaged"));
}

}  // namespace
}  // namespace orbid::journal_test
