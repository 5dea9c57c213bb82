#include "apps/campaign/journal/sqlite.hpp"

#include <unistd.h>

#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "apps/campaign/journal/journal.hpp"

namespace orbid::apps {
namespace {

/// How long another program may hold the file, in ms.
constexpr int patience = 20000;

/// A path as a URI (RFC 3986), for options that only a URI can give.
std::string file_uri(const std::filesystem::path& file, std::string_view options) {
    std::string uri = "file:";
    for (const char c : std::filesystem::absolute(file).string()) {
        if (c == '%' || c == '?' || c == '#') {
            uri += fmt::format("%{:02x}", static_cast<unsigned char>(c));
        } else {
            uri += c;
        }
    }
    return uri.append(options);
}

/// Readers of a file with a write-ahead log share memory in its folder. Where the folder cannot be written and no log
/// is left, nobody can change the file either.
bool unchangeable(const std::filesystem::path& file) {
    std::error_code none;
    const auto folder = std::filesystem::absolute(file).parent_path();
    auto log = file;
    log += "-wal";
    const auto size = std::filesystem::file_size(log, none);
    return ::access(folder.c_str(), W_OK) != 0 && (none || size == 0);
}

}  // namespace

void throw_sqlite_error(sqlite3* database, int status, const std::filesystem::path& file) {
    const std::string name = file.string();
    const std::string said = database != nullptr ? sqlite3_errmsg(database) : sqlite3_errstr(status);
    const int system = database != nullptr ? sqlite3_system_errno(database) : 0;
    const std::string reason =
        system != 0 ? fmt::format("{}: {}", said, std::generic_category().message(system)) : said;
    switch (status & 0xff) {
        case SQLITE_NOTADB:
            throw JournalDamaged(fmt::format("{} is not a journal, or its first page is destroyed", name));
        case SQLITE_CORRUPT:
            throw JournalDamaged(fmt::format("{} is damaged: {}", name, reason));
        case SQLITE_ERROR:
            if (said.starts_with("no such") || said.starts_with("malformed"))
                throw JournalDamaged(fmt::format("{} is not a whole journal: {}", name, said));
            break;
        case SQLITE_FULL:
            throw JournalError(fmt::format(
                "no space left for {} ({}): what was stored before is whole; make room, then go on", name, reason));
        case SQLITE_IOERR:
            throw JournalError(
                fmt::format("{} cannot be read or written ({}): what was stored before is whole; mend that, then go on",
                            name, reason));
        case SQLITE_BUSY:
        case SQLITE_LOCKED:
            throw JournalError(fmt::format("{} is held by another program: close it there, then go on", name));
        case SQLITE_READONLY:
        case SQLITE_PERM:
            throw JournalError(fmt::format("{} may not be written: {}", name, reason));
        case SQLITE_NOMEM:
            throw std::bad_alloc();
        default:
            break;
    }
    throw JournalError(fmt::format("{}: {}", name, reason));
}

SqliteFile::SqliteFile(std::filesystem::path file, Mode mode) : file_(std::move(file)) {
    int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_URI;
    flags |= mode == Mode::read ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE;
    if (mode == Mode::create) flags |= SQLITE_OPEN_CREATE;
    const bool immutable = mode == Mode::read && unchangeable(file_);
    const int status =
        sqlite3_open_v2(file_uri(file_, immutable ? "?immutable=1" : "").c_str(), &database_, flags, nullptr);
    try {
        check(status);
        sqlite3_extended_result_codes(database_, 1);
        sqlite3_busy_timeout(database_, patience);
        // A damaged file must not lead anywhere.
        run("PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA temp_store=MEMORY");
    } catch (...) {
        close();
        throw;
    }
}

SqliteFile::~SqliteFile() {
    close();
}

void SqliteFile::close() noexcept {
    for (const auto& [sql, statement] : often_)
        sqlite3_finalize(statement);
    often_.clear();
    sqlite3_close_v2(database_);
    database_ = nullptr;
}

void SqliteFile::run(const std::string& sql) {
    check(sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, nullptr));
}

void SqliteFile::run_often(std::string_view sql) {
    auto found = often_.find(sql);
    if (found == often_.end()) {
        sqlite3_stmt* statement = nullptr;
        check(sqlite3_prepare_v2(database_, sql.data(), static_cast<int>(sql.size()), &statement, nullptr));
        found = often_.emplace(sql, statement).first;
    }
    const int status = sqlite3_step(found->second);
    if (status != SQLITE_DONE) {
        try {
            throw_sqlite_error(database_, status, file_);
        } catch (...) {
            sqlite3_reset(found->second);
            throw;
        }
    }
    sqlite3_reset(found->second);
}

std::int64_t SqliteFile::number(const std::string& sql) {
    Statement statement(*this, sql);
    return statement.step() ? statement.integer(0) : 0;
}

Statement::Statement(const SqliteFile& file, std::string_view sql) : file_(file) {
    file_.check(sqlite3_prepare_v2(file.handle(), sql.data(), static_cast<int>(sql.size()), &statement_, nullptr));
}

bool Statement::step() {
    const int status = sqlite3_step(statement_);
    if (status == SQLITE_ROW) return true;
    if (status == SQLITE_DONE) {
        sqlite3_reset(statement_);
        return false;
    }
    // The reset repeats the error; the message is that of the step.
    try {
        throw_sqlite_error(file_.handle(), status, file_.path());
    } catch (...) {
        sqlite3_reset(statement_);
        throw;
    }
}

std::string_view Statement::bytes(int column) const {
    const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
    const int size = sqlite3_column_bytes(statement_, column);
    return data == nullptr ? std::string_view() : std::string_view(data, static_cast<std::size_t>(size));
}

Transaction::Transaction(SqliteFile& file, Kind kind) : file_(file) {
    open_ = kind == Kind::write || sqlite3_get_autocommit(file.handle()) != 0;
    if (open_) file_.run_often(kind == Kind::write ? "BEGIN IMMEDIATE" : "BEGIN");
}

Transaction::~Transaction() {
    // Some errors have undone it already: then there is nothing to undo.
    if (open_) sqlite3_exec(file_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

void Transaction::commit() {
    file_.run_often("COMMIT");
    open_ = false;
}

}  // namespace orbid::apps
