#include "apps/campaign/journal/journal.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "apps/campaign/journal/journal_database.hpp"

namespace orbid::apps {
namespace {

/// Files up to this size are checked whole whenever they are opened.
constexpr std::uintmax_t small_file = std::uintmax_t{32} << 20;

/// The write-ahead log grows to about 32 MB before its pages go to their places, and the cache holds as much twice.
constexpr const char* writer_settings =
    "PRAGMA synchronous=NORMAL; PRAGMA wal_autocheckpoint=8000; PRAGMA journal_size_limit=67108864; "
    "PRAGMA cache_size=-65536; PRAGMA secure_delete=OFF";

[[noreturn]] void damaged(const std::filesystem::path& file, const std::string& what) {
    throw JournalDamaged(fmt::format("{} is damaged: {}", file.string(), what));
}

[[noreturn]] void damaged_task(const std::filesystem::path& file, std::int64_t number) {
    damaged(file, fmt::format("what became of task {} is not what was written", number));
}

JournalHead read_head(const SqliteFile& file) {
    for (const auto* table : {"head", "head_copy"}) {
        Statement statement(file, fmt::format("SELECT content, checksum FROM {} WHERE id=0", table));
        if (!statement.step() || statement.integer(1) != head_checksum(statement.bytes(0)))
            damaged(file.path(), "it does not say what its campaign is");
        if (std::string_view(table) == "head_copy") return head_from_text(statement.bytes(0));
    }
    throw std::logic_error("unreachable");
}

/// Without any table, and nobody's: a file in which the first transaction did not come to its end.
bool is_empty(SqliteFile& file) {
    return file.number("PRAGMA application_id") == 0 && file.number("SELECT count(*) FROM sqlite_master") == 0;
}

void check_format(SqliteFile& file) {
    if (file.number("PRAGMA application_id") != 1869767012)
        throw JournalError(
            fmt::format("{} is a file of SQLite, but not the journal of a campaign", file.path().string()));
    const auto version = file.number("PRAGMA user_version");
    if (version != 1)
        throw JournalError(
            fmt::format("{} is a journal of format {}; this program reads format 1", file.path().string(), version));
}

}  // namespace

Journal::Journal(std::unique_ptr<Database> database) : database_(std::move(database)) {}
Journal::Journal(Journal&&) noexcept = default;
Journal& Journal::operator=(Journal&&) noexcept = default;
Journal::~Journal() = default;

bool Journal::is_begun(const std::filesystem::path& file) {
    if (!std::filesystem::exists(file)) return false;
    try {
        SqliteFile opened(file, SqliteFile::Mode::write);  // for reading, what a killed one left is an error
        return !is_empty(opened);
    } catch (const JournalError&) {
        return true;  // who opens it is told what is wrong with it
    }
}

Journal Journal::create(const std::filesystem::path& file, const JournalHead& head) {
    if (is_begun(file)) throw JournalError(fmt::format("{} exists already: a campaign is begun once", file.string()));
    std::set<std::string> names;
    for (const VariedColumn& column : head.varied)
        if (!names.insert(column.name).second)
            throw std::invalid_argument(fmt::format("two columns of a campaign have the name \"{}\"", column.name));
    auto database = std::make_unique<Database>(file, SqliteFile::Mode::create);
    SqliteFile& opened = database->file;
    // Somebody else may have begun it before the lock was had.
    if (!is_empty(opened))
        throw JournalError(fmt::format("{} exists already: a campaign is begun once", file.string()));
    opened.run(
        fmt::format("PRAGMA page_size={}; PRAGMA auto_vacuum=NONE; PRAGMA encoding='UTF-8'; "
                    "PRAGMA journal_mode=WAL",
                    journal_page));
    opened.run(writer_settings);
    Transaction transaction(opened, Transaction::Kind::write);
    make_tables(opened);
    make_views(opened, head);
    const std::string text = head_text(head);
    for (const auto* table : {"head", "head_copy"})
        Statement(opened, fmt::format("INSERT INTO {} VALUES(0,?,?)", table)).run(text, head_checksum(text));
    transaction.commit();
    database->head = head;
    return Journal(std::move(database));
}

Journal Journal::open(const std::filesystem::path& file, Access access) {
    std::error_code none;
    const auto size = std::filesystem::file_size(file, none);
    if (none) throw JournalError(fmt::format("cannot read {}: {}", file.string(), none.message()));
    auto database =
        std::make_unique<Database>(file, access == Access::write ? SqliteFile::Mode::write : SqliteFile::Mode::read);
    check_format(database->file);
    if (access == Access::write) database->file.run(writer_settings);
    database->head = read_head(database->file);
    Journal journal(std::move(database));
    if (access == Access::write || size <= small_file) journal.check();
    return journal;
}

const JournalHead& Journal::head() const {
    return database_->head;
}

const SqliteFile& Journal::database() const {
    return database_->file;
}

JournalCounts Journal::counts() const {
    Transaction view(database_->file, Transaction::Kind::read);
    const std::int64_t tasks = added();
    // Outcomes without a task there are only where tasks were lost. Not grouped by SQL, which would sort them.
    Statement statement(database_->file,
                        fmt::format("SELECT sum(state = 'done'), sum(state = 'failed'), total(seconds), "
                                    "total(processor_seconds) FROM outcome WHERE state <> 'waiting' {}",
                                    tasks < head().tasks ? "AND task IN (SELECT number FROM plan)" : ""));
    JournalCounts counts;
    if (statement.step()) {
        counts.done = statement.integer(0);
        counts.failed = statement.integer(1);
        counts.seconds = statement.real(2);
        counts.processor_seconds = statement.real(3);
    }
    counts.waiting = tasks - counts.done - counts.failed;
    return counts;
}

void Journal::check() const {
    const SqliteFile& file = database_->file;
    {
        Statement statement(file, "PRAGMA quick_check(1)");
        if (!statement.step() || statement.bytes(0) != "ok") damaged(file.path(), statement.text(0));
    }
    each_row([](const Row&) {});
    Transaction view(database_->file, Transaction::Kind::read);
    Statement others(
        file, fmt::format("SELECT {} FROM outcome WHERE task NOT IN (SELECT number FROM plan)", outcome_columns));
    OutcomeRow outcome;
    while (others.step())
        if (!read_outcome(others, 0, outcome)) damaged_task(file.path(), others.integer(0));
    Statement results(file,
                      "SELECT task, result_checksum, content FROM outcome LEFT JOIN result USING(task) "
                      "WHERE result_checksum <> 0 ORDER BY task");
    while (results.step())
        if (results.integer(1) != result_checksum(results.integer(0), results.bytes(2)))
            damaged_task(file.path(), results.integer(0));
}

void Journal::add_tasks(std::span<const TaskPlan> tasks) {
    RowWriter& rows = database_->writer();
    std::vector<int>& attempts = database_->attempts();
    Transaction transaction(database_->file, Transaction::Kind::write);
    for (const TaskPlan& plan : tasks) {
        if (plan.number < 0 || plan.number >= database_->head.tasks)
            throw std::invalid_argument(
                fmt::format("task {} of a campaign of {} tasks", plan.number, database_->head.tasks));
        if (plan.values.size() != database_->head.varied.size())
            throw std::invalid_argument(fmt::format("task {} has {} values of {} things that vary", plan.number,
                                                    plan.values.size(), database_->head.varied.size()));
        if (!rows.plan(plan)) throw std::invalid_argument(fmt::format("task {} is added twice", plan.number));
    }
    transaction.commit();
    for (const TaskPlan& plan : tasks) {
        int& count = attempts[static_cast<std::size_t>(plan.number)];
        count = -1 - count;
    }
}

std::int64_t Journal::added() const {
    return database_->file.number("SELECT count(*) FROM plan");
}

std::vector<std::int64_t> Journal::missing() const {
    std::vector<std::int64_t> out;
    std::int64_t next = 0;
    Statement statement(database_->file, "SELECT number FROM plan ORDER BY number");
    while (statement.step())
        for (const auto number = statement.integer(0); next <= number; ++next)
            if (next < number) out.push_back(next);
    for (; next < head().tasks; ++next)
        out.push_back(next);
    return out;
}

std::vector<std::int64_t> Journal::waiting() const {
    std::vector<std::int64_t> out;
    Statement statement(database_->file,
                        "SELECT number FROM plan LEFT JOIN outcome ON task = number "
                        "WHERE state IS NULL OR state = 'waiting' ORDER BY number");
    while (statement.step())
        out.push_back(statement.integer(0));
    return out;
}

void Journal::store(std::span<const TaskOutcome> outcomes) {
    RowWriter& rows = database_->writer();
    std::vector<int>& attempts = database_->attempts();
    std::map<std::int64_t, int> now;  ///< counted when all is written
    Transaction transaction(database_->file, Transaction::Kind::write);
    for (const TaskOutcome& outcome : outcomes) {
        if (outcome.state == TaskState::waiting)
            throw std::invalid_argument(fmt::format("the outcome of task {} is that it waits", outcome.number));
        if (outcome.number < 0 || outcome.number >= head().tasks ||
            attempts[static_cast<std::size_t>(outcome.number)] < 0)
            throw std::invalid_argument(fmt::format("there is no task {}", outcome.number));
        const auto [known, first] = now.try_emplace(outcome.number, attempts[static_cast<std::size_t>(outcome.number)]);
        if (known->second > 0) {
            rows.remove_parameters(outcome.number);
            rows.remove_result(outcome.number);
        }
        OutcomeRow row = outcome_row(outcome);
        row.attempts = ++known->second;
        rows.outcome(row);
        int position = 0;
        for (const TaskParameter& parameter : outcome.parameters)
            rows.parameter(outcome.number, position++, parameter);
        if (!outcome.result.empty()) rows.result(outcome.number, outcome.result);
    }
    transaction.commit();
    for (const auto& [number, count] : now)
        attempts[static_cast<std::size_t>(number)] = count;
}

std::int64_t Journal::retry(const std::string& status) {
    RowWriter& rows = database_->writer();
    Transaction transaction(database_->file, Transaction::Kind::write);
    std::vector<OutcomeRow> again;
    Statement failed(
        database_->file,
        fmt::format("SELECT {} FROM outcome WHERE state = 'failed' AND (?1 = '' OR status = ?1)", outcome_columns));
    failed.bind(status);
    while (failed.step())
        if (!read_outcome(failed, 0, again.emplace_back()))
            damaged_task(database_->file.path(), again.back().outcome.number);
    for (OutcomeRow& row : again) {
        row.outcome.state = TaskState::waiting;
        rows.outcome(row);
    }
    transaction.commit();
    return static_cast<std::int64_t>(again.size());
}

void Journal::each_row(const std::function<void(const Row&)>& use) const {
    const auto& path = database_->file.path();
    Transaction view(database_->file, Transaction::Kind::read);
    Statement tasks(database_->file, fmt::format("SELECT {}, {} FROM plan LEFT JOIN outcome ON task = number "
                                                 "ORDER BY number",
                                                 plan_columns, outcome_columns));
    Statement parameters(database_->file,
                         fmt::format("SELECT {} FROM parameter ORDER BY task, position", parameter_columns));
    bool more = parameters.step();
    Row row;
    OutcomeRow outcome;
    while (tasks.step()) {
        if (!read_plan(tasks, 0, row.plan))
            damaged(path, fmt::format("task {} is not what was written", row.plan.number));
        const bool tried = !tasks.null(5);
        if (tried && !read_outcome(tasks, 5, outcome)) damaged_task(path, row.plan.number);
        if (!tried) {
            outcome = {};
            outcome.outcome.number = row.plan.number;
            outcome.outcome.state = TaskState::waiting;
        }
        row.outcome = outcome.outcome;
        row.attempts = outcome.attempts;
        row.outcome.parameters.clear();
        for (; more && parameters.integer(0) <= row.plan.number; more = parameters.step())
            if (parameters.integer(0) == row.plan.number)
                read_parameter(parameters, 0, row.outcome.parameters.emplace_back());
        if (tried ? parameters_checksum(row.plan.number, row.outcome.parameters) != outcome.parameters
                  : !row.outcome.parameters.empty())
            damaged_task(path, row.plan.number);
        use(row);
    }
}

std::string Journal::result(std::int64_t number) const {
    Statement statement(database_->file,
                        "SELECT result_checksum, content FROM outcome LEFT JOIN result USING(task) WHERE task = ?");
    statement.bind(number);
    if (!statement.step()) return {};
    std::string content = statement.text(1);
    if (statement.integer(0) != result_checksum(number, content)) damaged_task(database_->file.path(), number);
    return content;
}

}  // namespace orbid::apps
