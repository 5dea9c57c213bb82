#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "apps/campaign/journal/row_values.hpp"

namespace orbid::apps {

/// The pages of a file of SQLite with those of its write-ahead log, read without SQLite: what is destroyed leads
/// nowhere. Pages have `journal_page` bytes and count from 1. Source: https://www.sqlite.org/fileformat2.html,
/// sections 1.6 (b-tree pages), 2.1 (records) and 4 (the log).
class JournalPages {
public:
    /// @throws JournalError when the file cannot be read.
    explicit JournalPages(const std::filesystem::path& file);

    [[nodiscard]] std::int64_t count() const { return count_; }
    /// Empty when there is no such page. The last one may be cut off.
    [[nodiscard]] std::string page(std::int64_t number);

private:
    void read_log(const std::filesystem::path& log);

    std::ifstream file_;
    std::ifstream log_;
    std::int64_t count_ = 0;
    std::unordered_map<std::int64_t, std::int64_t> in_log_;  ///< place of a page's last committed copy in the log
};

/// A row as a page holds it. Where the key of the table is no value of the record, column 0 is the key.
class PageRow final : public RowValues {
public:
    /// @return false when the bytes are no record.
    [[nodiscard]] bool read(std::string record, bool has_key, std::int64_t key);

    [[nodiscard]] int columns() const { return static_cast<int>(columns_.size()); }
    /// Whether the row is of a table with a key of its own, not of an index.
    [[nodiscard]] bool has_key() const { return has_key_; }
    [[nodiscard]] std::int64_t integer(int column) const override;
    [[nodiscard]] double real(int column) const override;
    [[nodiscard]] bool null(int column) const override { return type(column) == 0; }
    [[nodiscard]] bool blob(int column) const override { return type(column) >= 12 && type(column) % 2 == 0; }
    [[nodiscard]] std::string_view bytes(int column) const override;

private:
    struct Column {
        std::uint64_t type = 0;
        std::size_t begin = 0;
        std::size_t size = 0;
    };
    [[nodiscard]] std::uint64_t type(int column) const { return columns_[static_cast<std::size_t>(column)].type; }

    std::string record_;
    std::vector<Column> columns_;
    bool has_key_ = false;
    std::int64_t key_ = 0;
};

/// Every row that can be read, page by page, old copies on pages out of use too. Nothing says that a row is right.
/// @param use  returns false to stop.
void each_page_row(JournalPages& pages, const std::function<bool(const PageRow&)>& use);

}  // namespace orbid::apps
