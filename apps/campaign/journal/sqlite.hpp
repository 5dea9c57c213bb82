#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <sqlite3.h>

#include "apps/campaign/journal/row_values.hpp"

namespace orbid::apps {

/// Throws what a status of SQLite means for the file: JournalDamaged, or JournalError with what to do.
[[noreturn]] void throw_sqlite_error(sqlite3* database, int status, const std::filesystem::path& file);

/// An open file of SQLite. One thread at a time.
class SqliteFile {
public:
    enum class Mode { create, write, read };

    /// @throws JournalError
    SqliteFile(std::filesystem::path file, Mode mode);
    ~SqliteFile();
    SqliteFile(const SqliteFile&) = delete;
    SqliteFile& operator=(const SqliteFile&) = delete;

    /// Statements without result, one after the other.
    void run(const std::string& sql);
    /// A statement without result that is run again and again: prepared once.
    void run_often(std::string_view sql);
    /// The first column of the first row; 0 without rows.
    [[nodiscard]] std::int64_t number(const std::string& sql);
    [[nodiscard]] const std::filesystem::path& path() const { return file_; }
    [[nodiscard]] sqlite3* handle() const { return database_; }
    void check(int status) const {
        if (status != SQLITE_OK) [[unlikely]]
            throw_sqlite_error(database_, status, file_);
    }

private:
    void close() noexcept;

    std::filesystem::path file_;
    sqlite3* database_ = nullptr;
    std::map<std::string, sqlite3_stmt*, std::less<>> often_;
};

/// Bytes that are no text.
struct Blob {
    std::string_view bytes;
};

/// A prepared statement of a file that outlives it. Parameters count from 1, columns from 0.
class Statement final : public RowValues {
public:
    Statement(const SqliteFile& file, std::string_view sql);
    ~Statement() override { sqlite3_finalize(statement_); }
    Statement(const Statement&) = delete;
    Statement& operator=(const Statement&) = delete;

    /// Binds all parameters; texts must live until the statement is reset or run again. nan becomes NULL.
    template <class... Values>
    Statement& bind(const Values&... values) {
        sqlite3_reset(statement_);
        int position = 0;
        (bind_one(++position, values), ...);
        return *this;
    }
    /// Runs a statement without result rows.
    template <class... Values>
    void run(const Values&... values) {
        bind(values...);
        while (step()) {
        }
        sqlite3_reset(statement_);
    }
    /// The next row; false after the last one, which resets.
    [[nodiscard]] bool step();
    void reset() { sqlite3_reset(statement_); }

    // Columns of the row that step() has reached.
    [[nodiscard]] std::int64_t integer(int column) const override { return sqlite3_column_int64(statement_, column); }
    [[nodiscard]] bool null(int column) const override {
        return sqlite3_column_type(statement_, column) == SQLITE_NULL;
    }
    [[nodiscard]] double real(int column) const override {
        return null(column) ? std::numeric_limits<double>::quiet_NaN() : sqlite3_column_double(statement_, column);
    }
    [[nodiscard]] std::string_view bytes(int column) const override;
    [[nodiscard]] bool blob(int column) const override {
        return sqlite3_column_type(statement_, column) == SQLITE_BLOB;
    }

private:
    void bind_one(int position, std::int64_t value) { file_.check(sqlite3_bind_int64(statement_, position, value)); }
    void bind_one(int position, int value) { bind_one(position, std::int64_t{value}); }
    void bind_one(int position, std::uint32_t value) { bind_one(position, std::int64_t{value}); }
    void bind_one(int position, double value) { file_.check(sqlite3_bind_double(statement_, position, value)); }
    void bind_one(int position, std::string_view value) {
        // A pointer that is null would be NULL instead of an empty text.
        file_.check(sqlite3_bind_text64(statement_, position, value.data() == nullptr ? "" : value.data(), value.size(),
                                        SQLITE_STATIC, SQLITE_UTF8));
    }
    void bind_one(int position, const std::string& value) { bind_one(position, std::string_view(value)); }
    void bind_one(int position, const char* value) { bind_one(position, std::string_view(value)); }
    void bind_one(int position, const Blob& value) {
        file_.check(sqlite3_bind_blob64(statement_, position, value.bytes.data() == nullptr ? "" : value.bytes.data(),
                                        value.bytes.size(), SQLITE_STATIC));
    }
    void bind_one(int position, const std::optional<std::int64_t>& value) {
        if (value) {
            bind_one(position, *value);
        } else {
            file_.check(sqlite3_bind_null(statement_, position));
        }
    }

    const SqliteFile& file_;
    sqlite3_stmt* statement_ = nullptr;
};

/// All or nothing: undone unless committed.
class Transaction {
public:
    enum class Kind { read, write };
    /// A view (read) within another transaction is part of it.
    Transaction(SqliteFile& file, Kind kind);
    ~Transaction();
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;
    void commit();

private:
    SqliteFile& file_;
    bool open_ = true;
};

}  // namespace orbid::apps
