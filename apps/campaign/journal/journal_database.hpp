#pragma once

#include <filesystem>
#include <optional>
#include <stdexcept>
#include <vector>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/journal/journal_lock.hpp"
#include "apps/campaign/journal/journal_tables.hpp"
#include "apps/campaign/journal/sqlite.hpp"

namespace orbid::apps {

/// What an open journal holds.
class Journal::Database {
public:
    Database(const std::filesystem::path& path, SqliteFile::Mode mode)
        : lock(mode == SqliteFile::Mode::read ? std::nullopt : std::optional<JournalLock>(std::in_place, path)),
          file(path, mode) {}

    std::optional<JournalLock> lock;  ///< released last
    SqliteFile file;
    JournalHead head;
    std::optional<RowWriter> rows;

    /// How often each task was run; -1 - that: there is no such task. Read once: nobody else writes.
    std::vector<int>& attempts() {
        if (!attempts_.empty()) return attempts_;
        attempts_.assign(static_cast<std::size_t>(head.tasks), -1);
        // Outcomes without a task there are where tasks were lost.
        Statement outcomes(file, "SELECT task, attempts FROM outcome");
        while (outcomes.step())
            attempts_.at(static_cast<std::size_t>(outcomes.integer(0))) = -1 - static_cast<int>(outcomes.integer(1));
        Statement tasks(file, "SELECT number FROM plan");
        while (tasks.step()) {
            int& count = attempts_.at(static_cast<std::size_t>(tasks.integer(0)));
            count = -1 - count;
        }
        return attempts_;
    }
    RowWriter& writer() {
        if (!lock) throw std::logic_error("a journal opened for reading is written");
        if (!rows) rows.emplace(file);
        return *rows;
    }

private:
    std::vector<int> attempts_;
};

}  // namespace orbid::apps
