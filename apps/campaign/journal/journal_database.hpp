#pragma once

#include <filesystem>
#include <optional>
#include <stdexcept>

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

    RowWriter& writer() {
        if (!lock) throw std::logic_error("a journal opened for reading is written");
        if (!rows) rows.emplace(file);
        return *rows;
    }
};

}  // namespace orbid::apps
