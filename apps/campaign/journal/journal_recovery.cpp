#include <algorithm>
#include <optional>
#include <set>

#include <fmt/format.h>

#include "apps/campaign/journal/journal_database.hpp"
#include "apps/campaign/journal/journal_pages.hpp"

namespace orbid::apps {
namespace {

std::optional<JournalHead> head_in(JournalPages& pages) {
    std::optional<JournalHead> head;
    each_page_row(pages, [&head](const PageRow& row) {
        if (row.has_key() && row.columns() == 3 && row.integer(2) == head_checksum(row.bytes(1)))
            head = head_from_text(row.bytes(1));
        return !head;
    });
    return head;
}

/// Puts rows of damaged pages into the tables of a new journal. Of several copies of an outcome the last attempt
/// counts.
class Salvage {
public:
    Salvage(SqliteFile& file, std::int64_t tasks) : rows_(file), tasks_(tasks) {}

    void take(const PageRow& row) {
        const std::int64_t task = row.integer(0);
        if (task < 0 || task >= tasks_) return;
        if (!row.has_key()) {
            take_parameter(row, task);
        } else if (row.columns() == plan_column_count) {
            if (read_plan(row, 0, plan_)) (void)rows_.plan(plan_);
        } else if (row.columns() == outcome_column_count) {
            if (read_outcome(row, 0, outcome_) && newest(task, outcome_.attempts)) rows_.outcome(outcome_);
        } else if (row.columns() == 2 && row.blob(1)) {
            rows_.result(task, row.bytes(1));
        }
    }

private:
    void take_parameter(const PageRow& row, std::int64_t task) {
        if (row.columns() != parameter_column_count || row.integer(1) < 0 || row.integer(1) > 1 << 20) return;
        read_parameter(row, 0, parameter_);
        rows_.parameter(task, static_cast<int>(row.integer(1)), parameter_);
    }
    bool newest(std::int64_t task, int attempts) {
        if (attempts_.empty()) attempts_.resize(static_cast<std::size_t>(tasks_), 0);
        int& known = attempts_[static_cast<std::size_t>(task)];
        if (attempts <= known) return false;
        known = attempts;
        return true;
    }

    RowWriter rows_;
    std::int64_t tasks_;
    std::vector<int> attempts_;
    TaskPlan plan_;
    OutcomeRow outcome_;
    TaskParameter parameter_;
};

/// Tasks of which something is left, but not all.
std::set<std::int64_t> incomplete_tasks(const SqliteFile& file) {
    std::set<std::int64_t> out;
    Statement outcomes(file,
                       "SELECT outcome.task, parameters_checksum, result_checksum, content "
                       "FROM outcome LEFT JOIN result ON result.task = outcome.task ORDER BY outcome.task");
    Statement parameters(file, fmt::format("SELECT {} FROM parameter ORDER BY task, position", parameter_columns));
    bool more = parameters.step();
    std::vector<TaskParameter> of_task;
    while (outcomes.step()) {
        const std::int64_t task = outcomes.integer(0);
        of_task.clear();
        for (; more && parameters.integer(0) <= task; more = parameters.step()) {
            if (parameters.integer(0) < task) {
                out.insert(parameters.integer(0));
            } else {
                read_parameter(parameters, 0, of_task.emplace_back());
            }
        }
        if (parameters_checksum(task, of_task) != outcomes.integer(1) ||
            result_checksum(task, outcomes.bytes(3)) != outcomes.integer(2))
            out.insert(task);
    }
    for (; more; more = parameters.step())
        out.insert(parameters.integer(0));
    Statement results(file, "SELECT task FROM result WHERE task NOT IN (SELECT task FROM outcome)");
    while (results.step())
        out.insert(results.integer(0));
    return out;
}

std::filesystem::path with_suffix(std::filesystem::path path, std::string_view suffix) {
    return path += suffix;
}

/// "campaign.damaged.sqlite", or the first "campaign.damaged-2.sqlite" that there is not yet.
std::filesystem::path name_for_damaged(const std::filesystem::path& file) {
    for (int k = 1;; ++k) {
        auto path = file;
        path.replace_extension(k == 1 ? ".damaged" : fmt::format(".damaged-{}", k));
        path += file.extension();
        if (!std::filesystem::exists(path)) return path;
    }
}

void remove_journal(const std::filesystem::path& file) {
    std::error_code ignored;
    for (const auto* suffix : {"", "-wal", "-shm", "-journal"})
        std::filesystem::remove(with_suffix(file, suffix), ignored);
    std::filesystem::remove(JournalLock::file(file), ignored);
}

/// The new file takes the place of the old one, which at no moment is without a name.
std::filesystem::path exchange(const std::filesystem::path& file, const std::filesystem::path& recovered) {
    const auto kept = name_for_damaged(file);
    const auto log = with_suffix(file, "-wal");
    std::error_code no_links;
    std::filesystem::create_hard_link(file, kept, no_links);
    if (no_links) std::filesystem::copy_file(file, kept);
    if (std::filesystem::exists(log)) std::filesystem::rename(log, with_suffix(kept, "-wal"));
    std::filesystem::remove(with_suffix(file, "-shm"));
    std::filesystem::rename(recovered, file);
    return kept;
}

}  // namespace

RecoveredJournal Journal::recover(const std::filesystem::path& file, const JournalHead* head) {
    const JournalLock lock(file);
    JournalPages pages(file);
    auto found = head_in(pages);
    if (!found && head != nullptr) found = *head;
    if (!found)
        throw JournalError(fmt::format("nothing in {} says what its campaign is, and nothing can be recovered without",
                                       file.string()));
    auto recovered = file;
    recovered.replace_extension(".recovered");
    recovered += file.extension();
    remove_journal(recovered);
    RecoveredJournal out{.damaged = {}, .tasks = found->tasks};
    try {
        {
            Journal journal = create(recovered, *found);
            SqliteFile& to = journal.database_->file;
            // The file is thrown away if this is interrupted.
            to.run("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF");
            Transaction transaction(to, Transaction::Kind::write);
            {
                Salvage salvage(to, found->tasks);
                each_page_row(pages, [&salvage](const PageRow& row) {
                    salvage.take(row);
                    return true;
                });
            }
            const auto lost = incomplete_tasks(to);
            RowWriter& rows = journal.database_->writer();
            for (const std::int64_t task : lost) {
                rows.remove_outcome(task);
                rows.remove_parameters(task);
                rows.remove_result(task);
            }
            transaction.commit();
            out.lost_outcomes = static_cast<std::int64_t>(lost.size());
            out.lost_tasks = found->tasks - journal.added();
            out.ended = to.number("SELECT count(*) FROM outcome WHERE state <> 'waiting'");
            journal.check();
            // What was written goes to the disk with the next transaction.
            to.run(
                "PRAGMA synchronous=FULL; PRAGMA journal_mode=DELETE; PRAGMA user_version=1; "
                "PRAGMA journal_mode=WAL");
        }
        out.damaged = exchange(file, recovered);
    } catch (...) {
        remove_journal(recovered);
        throw;
    }
    remove_journal(recovered);
    return out;
}

}  // namespace orbid::apps
