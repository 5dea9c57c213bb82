#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::orbits {

/// A text file with a header line, cut into cells on demand. Comments, empty lines, quotes, line ends and the byte
/// order mark are handled here; the caller interprets the cells.
class TextTable {
public:
    /// Reads the whole file and its header.
    /// @throws DataError: file missing, a folder, unreadable, empty, a header cell quoted wrongly.
    explicit TextTable(const std::filesystem::path& file);
    /// The same of a text that was made of a file; its first row is line 1 in messages, or comes after so many lines.
    TextTable(const std::filesystem::path& file, std::string text, std::size_t lines_before = 0);

    [[nodiscard]] const std::string& file() const { return file_; }
    [[nodiscard]] const std::vector<std::string>& header() const { return header_; }
    /// Index of the column with this header.
    /// @throws DataError when there is none (listing what exists, and the nearest) or more than one.
    [[nodiscard]] std::size_t column(const std::string& name) const;

    /// Cuts the next row into cells, without surrounding blanks. The cells are valid until the next call.
    /// @return false after the last row.
    /// @throws DataError when the number of cells differs from the header's, or a quote does not end on its line.
    bool next(std::vector<std::string_view>& cells);
    [[nodiscard]] std::size_t line() const { return line_; }  ///< of the last row, from 1

    /// The number in a cell.
    /// @throws DataError naming line, column and rule when the cell holds no number or one beyond the range of double.
    [[nodiscard]] double number(std::string_view cell, std::size_t column) const;

    /// Throws DataError "file:line, column \"name\": what"; without a line that of the last row.
    [[noreturn]] void fail(std::size_t line, std::size_t column, std::string_view what) const;
    [[noreturn]] void fail(std::size_t column, std::string_view what) const { fail(line_, column, what); }

private:
    void read_header();
    [[noreturn]] void fail(std::string_view what) const;
    bool next_line(std::string_view& line);
    void cut(std::string_view line, std::vector<std::string_view>& cells);
    std::string_view quoted(std::string_view line, std::size_t& end);

    std::string file_;
    std::string text_;
    std::size_t position_ = 0;
    std::size_t line_ = 0;
    char delimiter_ = ',';
    std::vector<std::string> header_;
    std::vector<std::string> unquoted_;  ///< storage of cells with quotes inside quotes
};

/// The table in a text file, or in one of Matlab: then its columns of these names (matlab_table).
[[nodiscard]] TextTable open_table(const std::filesystem::path& file, const std::vector<std::string>& names = {});

}  // namespace orbid::orbits
