#include "orbits/records/text_table.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <system_error>

#include <fmt/format.h>

#include "orbits/records/data_file.hpp"
#include "orbits/records/matlab_file.hpp"
#include "orbits/records/nearest_name.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";

bool blank(char c) {
    return c == ' ' || c == '\t' || c == '\r';
}

/// Without blanks at either end. A tab counts as a blank only where it does not delimit.
std::string_view trimmed(std::string_view cell) {
    while (!cell.empty() && blank(cell.front()))
        cell.remove_prefix(1);
    while (!cell.empty() && blank(cell.back()))
        cell.remove_suffix(1);
    return cell;
}

/// Piece by piece: a file without ends of lines is refused before it fills the memory.
std::string whole_file(const std::filesystem::path& path) {
    const std::uintmax_t size = require_data_file(path);
    std::ifstream stream(path, std::ios::binary);
    const auto system = [] { return std::generic_category().message(errno); };
    if (!stream) throw DataError(fmt::format("{}: cannot be opened for reading: {}", path.string(), system()));
    std::string text;
    text.reserve(static_cast<std::size_t>(size));
    // One byte more than the file: the first read of a small one finds its end.
    std::string piece(std::min(static_cast<std::size_t>(size) + 1, std::size_t{1} << 20), '\0');
    std::size_t line_start = 0, lines = 0;
    while (stream) {
        stream.read(piece.data(), static_cast<std::streamsize>(piece.size()));
        const std::string_view got(piece.data(),
                                   static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
        text += got;
        lines += static_cast<std::size_t>(std::count(got.begin(), got.end(), '\n'));
        if (const auto last = got.rfind('\n'); last != std::string_view::npos)
            line_start = text.size() - got.size() + last + 1;
        refuse_record_if(text.size() - line_start > longest_table_line,
                         "{}:{}: the line has more than {} bytes; is it a table of text?", path.string(), lines + 1,
                         longest_table_line);
    }
    if (stream.bad()) throw DataError(fmt::format("{}: cannot be read to its end: {}", path.string(), system()));
    return text;
}

/// The delimiter that the header has most of, outside quotes. Ties go to the first of the list.
char delimiter_of(std::string_view header) {
    constexpr std::string_view candidates = ",;\t";
    char best = candidates.front();
    std::ptrdiff_t most = 0;
    for (const char candidate : candidates) {
        std::ptrdiff_t count = 0;
        bool inside = false;
        for (const char c : header) {
            inside = inside != (c == '"');
            count += !inside && c == candidate ? 1 : 0;
        }
        if (count > most) {
            most = count;
            best = candidate;
        }
    }
    return best;
}

/// A cell as shown in a message: long ones are cut.
std::string shown(std::string_view cell) {
    constexpr std::size_t longest = 40;
    return cell.size() <= longest ? std::string(cell) : fmt::format("{}...", cell.substr(0, longest));
}

}  // namespace

TextTable::TextTable(const std::filesystem::path& file) : file_(file.string()), text_(whole_file(file)) {
    if (text_.starts_with(byte_order_mark)) position_ = byte_order_mark.size();
    if (std::memchr(text_.data(), '\0', std::min<std::size_t>(text_.size(), 4096)) != nullptr)
        throw DataError(fmt::format("{}: is not a text file (it holds zero bytes); export the table as UTF-8", file_));
    read_header();
}

TextTable::TextTable(const std::filesystem::path& file, std::string text, std::size_t lines_before)
    : file_(file.string()), text_(std::move(text)) {
    read_header();
    line_ = lines_before;
}

void TextTable::read_header() {
    std::string_view line;
    if (!next_line(line))
        throw DataError(fmt::format("{}: is empty; a header line and at least one row are needed", file_));
    delimiter_ = delimiter_of(line);
    std::vector<std::string_view> cells;
    cut(line, cells);
    refuse_record_if(cells.size() > most_table_columns, "{}:{}: has {} columns, at most {} are read", file_, line_,
                     cells.size(), most_table_columns);
    header_.assign(cells.begin(), cells.end());
}

std::size_t TextTable::column(const std::string& name) const {
    const auto found = std::find(header_.begin(), header_.end(), name);
    if (found == header_.end()) {
        const auto nearest = nearest_name(name, header_);
        throw DataError(fmt::format("{}: no column \"{}\"{}; the columns are {}", file_, shown(name),
                                    nearest ? fmt::format(" (did you mean \"{}\"?)", *nearest) : "",
                                    shown_names(header_)));
    }
    if (std::find(found + 1, header_.end(), name) != header_.end())
        throw DataError(fmt::format("{}: column \"{}\" appears twice in the header; names must differ", file_, name));
    return static_cast<std::size_t>(found - header_.begin());
}

bool TextTable::next_line(std::string_view& line) {
    while (position_ < text_.size()) {
        const char* begin = text_.data() + position_;
        const std::size_t left = text_.size() - position_;
        const auto* end = static_cast<const char*>(std::memchr(begin, '\n', left));
        const std::size_t length = end == nullptr ? left : static_cast<std::size_t>(end - begin);
        position_ += length + (end == nullptr ? 0 : 1);
        ++line_;
        line = {begin, length};
        if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
        const std::string_view content = trimmed(line);
        // A row of tabs alone is a row of missing samples when tabs delimit, not an empty line.
        const bool empty = content.empty() && !(delimiter_ == '\t' && line.find('\t') != std::string_view::npos);
        if (!empty && !content.starts_with('#')) return true;
    }
    return false;
}

std::string_view TextTable::quoted(std::string_view line, std::size_t& end) {
    // `end` stands on the opening quote and is moved behind the closing one.
    const std::size_t begin = end + 1;
    std::size_t close = begin;
    bool doubled = false;
    while (true) {
        close = line.find('"', close);
        if (close == std::string_view::npos) fail("a quote is opened and not closed on the same line");
        if (close + 1 >= line.size() || line[close + 1] != '"') break;
        doubled = true;
        close += 2;
    }
    end = close + 1;
    const std::string_view content = line.substr(begin, close - begin);
    if (!doubled) return content;
    std::string text;
    for (std::size_t i = 0; i < content.size(); ++i) {
        text += content[i];
        if (content[i] == '"') ++i;
    }
    unquoted_.push_back(std::move(text));
    return unquoted_.back();
}

void TextTable::cut(std::string_view line, std::vector<std::string_view>& cells) {
    cells.clear();
    unquoted_.clear();
    // Views into unquoted_ must survive its growth: short strings live inside the objects.
    if (line.find("\"\"") != std::string_view::npos) unquoted_.reserve(line.size() / 2 + 1);
    std::size_t position = 0;
    while (true) {
        std::size_t start = position;
        while (start < line.size() && blank(line[start]) && line[start] != delimiter_)
            ++start;
        if (start < line.size() && line[start] == '"') {
            cells.push_back(quoted(line, start));
            while (start < line.size() && line[start] != delimiter_) {
                if (!blank(line[start])) {
                    fail("text follows a closing quote; a delimiter or the end of the line must");
                }
                ++start;
            }
            position = start;
        } else {
            const std::size_t end = std::min(line.find(delimiter_, position), line.size());
            cells.push_back(trimmed(line.substr(position, end - position)));
            position = end;
        }
        if (position >= line.size()) return;
        ++position;  // behind the delimiter
    }
}

bool TextTable::next(std::vector<std::string_view>& cells) {
    std::string_view line;
    if (!next_line(line)) return false;
    cut(line, cells);
    if (cells.size() != header_.size()) {
        std::string hint;
        if (delimiter_ == ',' && cells.size() > header_.size() && cells.size() % header_.size() == 0)
            hint = " (decimal commas? numbers are written with a point)";
        if (cells.size() < header_.size()) hint = "; the cell of a missing sample is there, and empty";
        fail(fmt::format("has {} cell{}, the header has {} columns{}", cells.size(), cells.size() == 1 ? "" : "s",
                         header_.size(), hint));
    }
    return true;
}

double TextTable::number(std::string_view cell, std::size_t column) const {
    std::string_view digits = cell;
    if (digits.starts_with('+') && digits.size() > 1 && digits[1] != '-') digits.remove_prefix(1);
    double value = 0.0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error == std::errc::result_out_of_range && end == digits.data() + digits.size())
        fail(column,
             fmt::format("\"{}\" is outside the range of a double; another unit, or an empty cell", shown(cell)));
    if (error != std::errc{} || end != digits.data() + digits.size()) {
        const bool decimal_comma = cell.find(',') != std::string_view::npos;
        fail(column, fmt::format("\"{}\" is not a number; {}", shown(cell),
                                 decimal_comma ? "numbers are written with a decimal point"
                                               : "a missing sample is an empty cell"));
    }
    return value;
}

void TextTable::fail(std::size_t line, std::size_t column, std::string_view what) const {
    throw DataError(fmt::format("{}:{}, column \"{}\": {}", file_, line, header_[column], what));
}

void TextTable::fail(std::string_view what) const {
    throw DataError(fmt::format("{}:{}: {}", file_, line_, what));
}

TextTable open_table(const std::filesystem::path& file, const std::vector<std::string>& names) {
    if (is_matlab_file(file)) return {file, matlab_table(file, names)};
    return TextTable(file);
}

}  // namespace orbid::orbits
