#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/campaign/journal/task_outcome.hpp"

namespace orbid::apps {

class SqliteFile;

/// One thing that varies between tasks.
struct VariedColumn {
    std::string name;     ///< column in tables: unique among them
    std::string pointer;  ///< JSON Pointer into the job; empty: not a value of the job (its file, a replicate's number)
    bool replicate = false;  ///< differs between replicates of the same setting: a seed, a value drawn anew
};

/// What a journal says of its campaign.
struct JournalHead {
    std::string title;
    std::string kind;
    std::string document;  ///< the campaign's JSON with all defaults, as text
    std::string key;       ///< SHA-256 of what decides the tasks and their results, in hexadecimal digits
    std::string version;   ///< of the program that made it
    double created = 0;    ///< Unix time, in s
    std::int64_t tasks = 0;
    std::vector<VariedColumn> varied;
};

struct JournalCounts {
    std::int64_t waiting = 0;
    std::int64_t done = 0;
    std::int64_t failed = 0;
    double seconds = 0;            ///< of all tasks that ended, summed
    double processor_seconds = 0;  ///< likewise
};

/// A journal that cannot be used: not a journal, damaged, of another campaign, in use; what() says which and what to
/// do.
class JournalError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// A journal of which a part is destroyed; Journal::recover() reads what is whole.
class JournalDamaged : public JournalError {
public:
    using JournalError::JournalError;
};

/// What Journal::recover() found.
struct RecoveredJournal {
    std::filesystem::path damaged;   ///< where the damaged file is now
    std::int64_t tasks = 0;          ///< of the campaign
    std::int64_t ended = 0;          ///< tasks whose outcome is whole
    std::int64_t lost_outcomes = 0;  ///< tasks that ended, as traces show, and wait again; others may have left none
    std::int64_t lost_tasks = 0;     ///< tasks to be added again (Journal::missing)
};

/// The journal of a campaign: a file of SQLite, one writer at a time, any number of readers beside it. Every call that
/// writes is one transaction: a process killed at any time leaves what was written before it. The tables are documented
/// in docs/campaigns.md.
///
/// Each row carries a checksum, which is compared wherever a row is read here: a call that meets a destroyed part
/// throws JournalDamaged. One thread at a time uses a Journal. A process that forks without calling another program
/// passes the right to write on to its child.
class Journal {
public:
    enum class Access { read, write };

    /// Whether there is a journal. Of one whose making was interrupted nothing was written but an empty file.
    [[nodiscard]] static bool is_begun(const std::filesystem::path& file);
    /// A new journal; there must be none (is_begun).
    /// @throws JournalError when it cannot be made.
    [[nodiscard]] static Journal create(const std::filesystem::path& file, const JournalHead& head);
    /// @throws JournalError when the file is not a whole journal, or, for writing, another process writes it.
    /// For writing every row is checked; for reading every row of a file up to 32 MB, of a larger one only what tells
    /// what the file is: the rest is checked when it is read.
    [[nodiscard]] static Journal open(const std::filesystem::path& file, Access access);
    /// Makes a new journal of what is whole in a damaged one, which stays beside it under another name. Tasks whose
    /// outcome is lost wait again. Works without a readable first page, too.
    /// @param head  taken when both copies in the file are destroyed.
    /// @throws JournalError when nothing says what the campaign is, the file cannot be read, or a process writes it.
    static RecoveredJournal recover(const std::filesystem::path& file, const JournalHead* head = nullptr);

    Journal(Journal&&) noexcept;
    Journal& operator=(Journal&&) noexcept;
    ~Journal();

    [[nodiscard]] const JournalHead& head() const;
    [[nodiscard]] JournalCounts counts() const;

    /// Reads every row and page. Tells an interrupted campaign from a damaged one.
    /// @throws JournalDamaged
    void check() const;

    /// Adds tasks as waiting ones.
    /// @throws std::invalid_argument on a number outside the campaign or one that there is already.
    void add_tasks(std::span<const TaskPlan> tasks);
    /// Tasks there are, however they stand: less than head().tasks when the adding was interrupted.
    [[nodiscard]] std::int64_t added() const;
    /// Numbers below head().tasks of tasks that there are not, ascending: the adding was interrupted, or they were
    /// lost.
    [[nodiscard]] std::vector<std::int64_t> missing() const;
    /// Numbers of waiting tasks, ascending.
    [[nodiscard]] std::vector<std::int64_t> waiting() const;
    /// Stores outcomes, each in place of an earlier one of its task; attempts are counted.
    /// @throws std::invalid_argument on a number that there is not, or the state waiting.
    void store(std::span<const TaskOutcome> outcomes);
    /// Failed tasks wait again; their attempts and last message stay until they have run.
    /// @param status  only those of this status; empty: all.
    /// @return how many.
    std::int64_t retry(const std::string& status = {});

    /// A task and, if it ended, its outcome.
    struct Row {
        TaskPlan plan;
        TaskOutcome outcome;  ///< state waiting: nothing else of it is meaningful
        int attempts = 0;
    };
    /// All tasks in order, results left out (`outcome.result` is empty), one after the other.
    void each_row(const std::function<void(const Row&)>& use) const;
    /// result.json of a task; empty: none.
    [[nodiscard]] std::string result(std::int64_t number) const;

    /// For questions in SQL (tables, report).
    [[nodiscard]] const SqliteFile& database() const;

private:
    class Database;
    explicit Journal(std::unique_ptr<Database> database);
    std::unique_ptr<Database> database_;
};

}  // namespace orbid::apps
